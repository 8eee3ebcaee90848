"""Every option of a fit reaches its job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from facestage import cli
from reference.synthetic_case import Case


@pytest.mark.parametrize(
    ("arguments", "attribute", "value"),
    [
        (["--lights", "7"], lambda job: len(job.stage), 7),
        (["--light-color", "uniform"], lambda job: job.light_color, "uniform"),
        (["--freeze", "pose", "--freeze", "focal"], lambda job: job.freeze, ("pose", "focal")),
        (["--budget", "12"], lambda job: job.budget_seconds, 12.0),
        (["--seed", "9"], lambda job: job.seed, 9),
        (["--device", "cpu"], lambda job: job.device, "cpu"),
        (["--model", "npz:x.npz"], lambda job: job.model, "npz:x.npz"),
        (["--focal-px", "333"], lambda job: job.camera.focal_px, 333.0),
        (["--truth", "/t.npz"], lambda job: job.truth, Path("/t.npz")),
    ],
)
def test_every_option_reaches_the_job(case: Case, arguments: list[str], attribute: Callable, value: object):
    parser = cli.build_parser()
    plain = ["fit", str(case.photo), "--out", "o"]
    assert attribute(cli._job(parser.parse_args(plain + arguments))) == value
    if "--focal-px" not in arguments:
        assert attribute(cli._job(parser.parse_args(plain))) != value
    else:
        assert cli._job(parser.parse_args(plain)).camera is None
