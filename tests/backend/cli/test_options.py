"""Every option of a fit reaches its job."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from facestage import cli
from facestage.cli.jobs import read_job
from facestage.cli.parser import build_parser
from facestage.contract.environment import ENVIRONMENT_COUNT
from facestage.contract.errors import InputError
from facestage.contract.light_stage import FROZEN
from facestage.images.image_io import write_exr
from reference.known import known
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
        (["--plan", "full"], lambda job: job.plan, "full"),
        (["--surround", "on"], lambda job: job.surround, "on"),
        (["--texture-size", "4096"], lambda job: job.texture_size, 4096),
        (["--white-balance", "12,40.5"], lambda job: job.white_balance, (12.0, 40.5)),
        (["--white-balance", "1,.9,0.8"], lambda job: job.white_balance, (1.0, 0.9, 0.8)),
        (["--skin-tone", "-12.5"], lambda job: job.skin_tone, -12.5),
        (["--skin-tone=Very-Light"], lambda job: job.skin_tone, 62.5),
        (["--face", "2"], lambda job: job.face, 2),
        (["--truth", "/t.npz"], lambda job: job.truth, Path("/t.npz")),
        (
            ["--truth", "/s.npz", "--face-region", "/f.npy"],
            lambda job: job.face_region,
            Path("/f.npy"),
        ),
    ],
)
def test_every_option_reaches_the_job(
    case: Case, arguments: list[str], attribute: Callable, value: object
):
    parser = build_parser()
    plain = ["fit", str(case.photo), "--out", "o"]
    assert attribute(read_job(parser.parse_args(plain + arguments))) == value
    if "--focal-px" not in arguments:
        assert attribute(read_job(parser.parse_args(plain))) != value
    else:
        assert read_job(parser.parse_args(plain)).camera is None


def test_a_map_of_the_surroundings_is_the_light(case: Case, tmp_path: Path):
    sky = tmp_path / "sky.exr"
    write_exr(sky, np.ones((8, 16, 3), np.float32))
    fit = ["fit", str(case.photo), "--out", "o", "--environment"]
    job = read_job(build_parser().parse_args([*fit, f"{sky}@30"]))
    stage = known(job.stage)
    assert job.exposure == "unknown" and len(stage) == ENVIRONMENT_COUNT
    assert (stage.state == FROZEN).all() and (stage.position[:, 2] < 0).any()
    fewer = read_job(build_parser().parse_args([*fit, str(sky), "--lights", "20"]))
    assert len(known(fewer.stage)) == 20
    empty = tmp_path / "empty.exr"
    write_exr(empty, np.full((8, 16, 3), np.nan, np.float32))
    for wrong, words in (
        (f"{sky}@left", "turned by 'left'"),
        ("sky.png", "no .exr"),
        (str(empty), "^The map of the surroundings '.*' has no usable pixel"),
    ):
        with pytest.raises(InputError, match=words):
            read_job(build_parser().parse_args([*fit, wrong]))


@pytest.mark.parametrize("text", ["grey", "1", "1,2,3,4", "-1,2", "1,0,1", "nan,1,1", "1,,2"])
def test_a_white_balance_is_a_pixel_or_a_color(case: Case, text: str):
    fit = ["fit", str(case.photo), "--out", "o", f"--white-balance={text}"]
    with pytest.raises(InputError, match=r"expected X,Y, a pixel .* or R,G,B"):
        read_job(build_parser().parse_args(fit))


@pytest.mark.parametrize("plan", ["lean", "full"])
def test_the_plan_of_a_job_folder_holds_unless_the_command_line_says_otherwise(
    case: Case, tmp_path: Path, plan: str
):
    parser = build_parser()
    read_job(parser.parse_args(["fit", str(case.photo), "--out", "o", "--plan", plan])).save(
        tmp_path / "job"
    )
    from_folder = ["fit", "--job", str(tmp_path / "job"), "--out", "o"]
    assert read_job(parser.parse_args(from_folder)).plan == plan
    assert read_job(parser.parse_args([*from_folder, "--plan", "full"])).plan == "full"


def test_a_bench_of_the_plan_takes_no_cases(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert (
        cli.main(["bench", "--plan", "--case", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    )
    assert "--case" in capsys.readouterr().err and not (tmp_path / "out").exists()
