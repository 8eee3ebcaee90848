"""``facestage reflectance``, and ``facestage render --environment``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage import cli
from facestage.contract.reflectance import ReflectanceField
from facestage.images.image_io import read_exr, write_exr
from reference.command_line import Finished, call, events_of, refuse


@pytest.fixture(scope="module")
def field(finished: Finished, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("field") / "field"
    done = call("reflectance", finished[0], "--out", out, "--directions", "40", "--spp", "2")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert events_of(done.stdout)[-2].message == "40 of 40 directions"
    return out


def run(*arguments: object) -> None:
    assert cli.main([str(argument) for argument in arguments]) == 0


def test_a_result_and_its_field_are_relit_alike(finished: Finished, field: Path, tmp_path: Path):
    sky = np.linspace(0.2, 3.0, 32)[None, :, None] * np.ones((16, 1, 3))
    write_exr(tmp_path / "sky.exr", sky.astype(np.float32))
    said = f"{tmp_path / 'sky.exr'}@30"
    for name, what in (("field", field), ("traced", finished[0])):
        run("render", what, "--environment", said, "--out", tmp_path / f"{name}.exr")
    one, other = read_exr(tmp_path / "field.exr"), read_exr(tmp_path / "traced.exr")
    assert one.shape == other.shape == (96, 96, 3)
    assert np.sqrt(((one - other) ** 2).mean()) < 0.1 * other.mean()
    again = ("render", field, "--environment", said, "--strength", "2", "--out")
    run(*again, tmp_path / "bright.exr")
    np.testing.assert_allclose(read_exr(tmp_path / "bright.exr"), 2 * one, rtol=2e-3, atol=1e-5)
    run(*again, tmp_path / "bright.png")
    assert (tmp_path / "bright.png").stat().st_size > 500


@pytest.mark.parametrize(
    ("what", "options", "words"),
    [
        ("field", ["--environment", "sky.png", "--out", "a.exr"], "no .exr file"),
        ("field", ["--environment", "sky.exr@x", "--out", "a.exr"], "turned by 'x'"),
        ("field", ["--environment", "gone.exr", "--out", "a.exr"], "gone.exr"),
        ("field", ["--environment", "sky.exr", "--out", "a.jpg"], ".exr or .png"),
        ("field", ["--environment", "sky.exr"], "give --out FILE"),
        ("field", ["--environment", "sky.exr", "--out", "a.exr", "--spp", "2"], "leave out"),
        ("result", ["--environment", "sky.exr", "--out", "a.exr", "--strength", "0"], "is 0"),
        ("result", ["--environment", "sky.exr", "--out", "a.exr", "--cache"], "neither"),
        ("result", ["--strength", "2", "--out", "a.exr"], "give --environment"),
    ],
)
def test_bad_input_is_refused(
    finished: Finished,
    field: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    what: str,
    options: list[str],
    words: str,
):
    monkeypatch.chdir(tmp_path)
    write_exr(tmp_path / "sky.exr", np.ones((4, 8, 3), np.float32))
    folder = {"field": field, "result": finished[0]}[what]
    assert words in refuse(capsys, "render", folder, *options)
    assert not (tmp_path / "a.exr").exists()


def test_a_picture_that_is_missing_or_another_is_named(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    import shutil

    broken = Path(shutil.copytree(field, tmp_path / "field"))
    write_exr(tmp_path / "sky.exr", np.ones((4, 8, 3), np.float32))
    last = broken / ReflectanceField.load(broken).images[-1]
    write_exr(last, np.zeros((5, 4, 3), np.float32))
    command = ("render", broken, "--environment", tmp_path / "sky.exr", "--out", tmp_path / "a.exr")
    assert "has 4 x 5 pixels, expected 96 x 96" in refuse(capsys, *command)
    last.unlink()
    assert last.name in refuse(capsys, *command)
