"""The command that makes cases: which there are, whose seeds, and that they load."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from addon.synthetic.people import SIZE
from facestage.bench.cases import Case
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.given.truth import VertexTruth, read_truth
from reference.known import known


def test_every_case_has_its_own_name_and_repeats_get_a_number() -> None:
    from facestage_blender.headless.cases import choose
    from facestage_blender.synthetic.cases.recipe import RECIPES

    assert len({recipe.name for recipe in RECIPES}) == len(RECIPES) >= 14
    chosen = choose(len(RECIPES) + 2, [])
    assert len(chosen) == len(RECIPES) + 2
    assert chosen[f"{RECIPES[1].name}_2"] is RECIPES[1]
    assert list(choose(5, [RECIPES[3].name])) == [RECIPES[3].name]


def test_wrong_orders_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from facestage_blender.headless.cases import choose, main

    with pytest.raises(InputError, match="no case 'hat'"):
        choose(3, ["hat"])
    out = ["--out", str(tmp_path / "out")]
    for wrong in (
        ["--count", "0", *out],
        ["--size", "3", *out],
        ["--samples", "0", *out],
        ["--count", "1"],
    ):
        assert main(wrong) == 2
        assert capsys.readouterr().err.startswith("facestage: ")
    assert not (tmp_path / "out").exists()


def test_list_says_what_is_hard(capsys: pytest.CaptureFixture[str]) -> None:
    from facestage_blender.headless.cases import main
    from facestage_blender.synthetic.cases.recipe import RECIPES

    assert main(["--list", "--count", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [recipe.name for recipe in RECIPES[:3]]


def test_families_of_people_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    from facestage_blender.headless.cases import main

    for family, count, name in (
        ("tones", 36, "dark_a_lamp"),
        ("skies", 8, "studio"),
        ("below", 4, "hard_side_below"),
    ):
        assert main(["--list", "--people", family]) == 0
        names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
        assert len(names) == count and name in names


def test_command_line_writes_cases_that_load(
    scene,
    head: FaceModel,
    stand_in: Callable[[str], list[str]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from facestage_blender.headless.cases import main

    stand_in("works")
    order = [
        "--only",
        "hard_side",
        "interreflection",
        "--size",
        str(SIZE),
        "--samples",
        "2",
        "--seed",
        "4",
    ]
    assert main([*order, "--out", str(tmp_path / "a")]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [
        "hard_side",
        "interreflection",
    ]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [
        "hard_side",
        "interreflection",
    ]
    job = Case("hard_side", tmp_path / "a" / "hard_side", "default").job()
    camera = known(job.camera)
    assert (camera.width, camera.height) == (SIZE, SIZE)
    known(job.landmarks).check_inside(SIZE, SIZE)
    truth = read_truth(tmp_path / "a" / "hard_side" / "truth.npz", FaceGeometry(head))
    assert isinstance(truth, VertexTruth)
    assert truth.albedo_error(truth.arrays["albedo"]) == pytest.approx(0, abs=1e-6)  # float32
    # The stage's own lattice cannot give this light.
    assert known(truth.light_error(fibonacci_stage(), truth.vertices.mean(0))) > 0.1
    assert len(truth.arrays["light_position"]) == 2
    order.remove("interreflection")
    assert main([*order, "--out", str(tmp_path / "b")]) == 0
    for name in ("photo.png", "landmarks.json", "camera.json"):
        assert (tmp_path / "a/hard_side" / name).read_bytes() == (
            tmp_path / "b/hard_side" / name
        ).read_bytes()
