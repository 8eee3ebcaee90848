"""Command lines: what is done with each input, and what stands in for what would compute for
minutes.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from fuzz.consistent import RefusedError, check_array, require
from fuzz.readers.files import check_result


def read_render(folder: Path) -> None:
    """``facestage render`` with light and weight files, up to the renderer."""
    from facestage.fit.result import relight
    from facestage.images.image_io import read_exr
    from facestage.models.registry import load_model

    def stand_in(result: Any, *_samples: Any, **_options: Any) -> np.ndarray:
        check_result(result)
        load_model(result.model)
        for name in ("albedo.exr", "specular.exr", "roughness.exr"):
            if (result.folder / name).is_file():
                check_array(read_exr(result.folder / name), name)
        return np.zeros((result.camera.height, result.camera.width, 3), np.float32)

    lights = _json_or_none(folder / "lights.json", "light file")
    weights = _json_or_none(folder / "weights.json", "weight file")
    with (
        mock.patch.object(relight, "render", stand_in),
        mock.patch.object(relight, "relit", stand_in),
    ):
        relight.render_result(folder, folder / "out.png", lights, weights, None)


def _json_or_none(path: Path, what: str) -> dict[str, Any] | None:
    from facestage.contract.files.storage import read_json

    return read_json(path, what) if path.exists() else None


def run_command(folder: Path) -> None:
    """A command line in the input's folder; what would compute for minutes does nothing."""
    from facestage import cli

    arguments = [
        str(item).replace("\0", "") for item in json.loads((folder / "arguments.argv").read_bytes())
    ]
    error, output = io.StringIO(), io.StringIO()
    before = Path.cwd()
    os.chdir(folder)
    try:
        with _stand_ins(), contextlib.redirect_stderr(error), contextlib.redirect_stdout(output):
            try:
                code: object = cli.main(arguments)
            # argparse prints how a command is used and leaves.
            except SystemExit as leaving:
                code = leaving.code
                require(code in (0, 2), f"the exit code is {code}")
                return
    finally:
        os.chdir(before)
    require(code in (0, 2), f"the exit code is {code}")
    if code:
        sentence = error.getvalue()
        require(
            sentence.startswith("facestage: ") and sentence.endswith("\n"),
            f"no sentence: {sentence!r:.200}",
        )
        raise RefusedError(sentence[:-1])


@contextlib.contextmanager
def _stand_ins() -> Iterator[None]:
    def nothing(*_arguments: Any, **_options: Any) -> int:
        return 0

    names = {
        "facestage.fit.result.run": ("fit_job",),
        "facestage.fit.result.person": ("fit_person",),
        "facestage.fit.result.relight": ("make_cache", "render_result"),
        "facestage.fit.result.reflectance": ("make_field",),
        "facestage.fit.result.surroundings": ("render_field", "render_under_map"),
        "facestage.batch.run": ("counted",),
        "facestage.bench.run": ("run_bench",),
        "facestage.bench.plan_savings": ("run_plan_savings",),
        "facestage.stress.run": ("list_cases", "run_stress"),
        "facestage.doctor": ("run_doctor",),
    }
    modules = {name: types.ModuleType(name) for name in names}
    for name, functions in names.items():
        for function in functions:
            setattr(modules[name], function, nothing)
    modules["facestage.batch.run"].run_batch = lambda *_: []  # type: ignore[attr-defined]
    with mock.patch.dict(sys.modules, modules):
        yield
