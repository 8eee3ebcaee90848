"""Cases are what their recipes say: people, lamps and worn things against what is known of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.bench.cases import Case
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.given.truth import Truth
from facestage.models.registry import load_model
from reference.known import known

OCCLUDERS = ("cap", "fringe", "glasses", "strands")
SIZE = 48


@pytest.fixture(scope="module")
def model() -> FaceModel:
    """The default head: what is worn needs landmarks where a face has them."""
    return load_model("default")


def person_of(model: FaceModel, chosen: Any, seed: int, same: int | None = None) -> Any:
    """With small textures."""
    from facestage_blender.synthetic.cases import person

    return person.person_of(model, chosen, seed, same, albedo_size=192)


def recipe(name: str):
    from facestage_blender.synthetic.cases.recipe import RECIPES

    return next(recipe for recipe in RECIPES if recipe.name == name)


def landmarks_of(model: FaceModel, vertices: np.ndarray) -> np.ndarray:
    corners, weights = model.landmark_vertices("ibug68")
    return np.einsum("mi,mix->mx", weights, vertices[corners])


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


def test_a_seed_is_one_person_under_one_light(head: FaceModel) -> None:
    from facestage_blender.headless.cases import case_seed

    first, again, other = (
        person_of(head, recipe("freckles"), case_seed("freckles", seed)) for seed in (0, 0, 1)
    )
    for name in ("identity", "expression", "albedo", "specular", "model_to_camera"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    np.testing.assert_array_equal(first.stage.position, again.stage.position)
    assert not np.allclose(first.stage.position, other.stage.position)
    assert (
        len({case_seed(name, seed) for name in ("cap", "cap_2", "beard") for seed in range(3)}) == 9
    )


def test_photos_of_one_person_share_the_person_alone(head: FaceModel) -> None:
    from facestage_blender.headless.cases import case_seed, photos

    chosen = photos(2)
    first, second = (
        person_of(head, each, case_seed(f"7/{name}", 0), 7) for name, each in chosen.items()
    )
    other = person_of(head, chosen["photo_1"], case_seed("8/photo_1", 0), 8)
    for name in ("identity", "albedo", "specular", "roughness"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    for name in ("expression", "model_to_camera"):
        assert not np.array_equal(getattr(first, name), getattr(second, name))
    for wrong in (0, 9):
        with pytest.raises(InputError, match="expected 1 to 8"):
            photos(wrong)


def test_expressions_are_found_by_either_spelling(head: FaceModel) -> None:
    from facestage_blender.synthetic.cases.person import expression_weights

    wanted = {
        "mouthSmileLeft": 0.5,
        "mouthSmileRight": 0.4,
        "browInnerUp": 0.3,
        "jawOpen": 0.2,
        "tongueOut": 1.0,
    }
    for names, weights in (
        (("jawOpen", "mouthSmileRight", "mouthSmileLeft", "browInnerUp"), (0.2, 0.4, 0.5, 0.3)),
        (("browInnerUp_L", "browInnerUp_R", "mouthSmile_L", "mouthSmile_R"), (0.3, 0.3, 0.5, 0.4)),
    ):
        np.testing.assert_array_equal(
            expression_weights(replace(head, expression_names=names), wanted), weights
        )


def test_a_lamp_lights_the_face_as_much_as_it_says() -> None:
    from facestage_blender.synthetic.cases.lamps import (
        AIM_SPREAD,
        ANGLE_SPREAD,
        DISTANCE_SPREAD,
        POWER_SPREAD,
        Lamp,
        light_stage,
    )

    lamps = [
        Lamp(azimuth, 20, 2.0, distance, side)
        for azimuth in (-60, 150)
        for distance, side in ((1, 0.01), (2, 0.1))
    ]
    stage = light_stage(lamps, np.random.default_rng(4))
    distance = np.linalg.norm(stage.position, axis=1)
    np.testing.assert_allclose(distance, [1, 2, 1, 2], rtol=DISTANCE_SPREAD)
    np.testing.assert_allclose(np.linalg.norm(stage.direction, axis=1), 1)
    np.testing.assert_allclose((stage.axis_x * stage.direction).sum(1), 0, atol=1e-12)
    aim = -(stage.direction * stage.position).sum(1) / distance
    assert (aim > np.cos(np.radians(2 * AIM_SPREAD))).all()
    # A small lamp of radiance L and area A, seen face on from distance d: E = L A / d^2.
    irradiance = stage.radiance * (stage.side**2 / distance**2)[:, None]
    np.testing.assert_allclose(irradiance, 2.0, rtol=POWER_SPREAD)
    azimuth = np.degrees(np.arctan2(stage.position[:, 0], stage.position[:, 2]))
    np.testing.assert_allclose(azimuth, [-60, -60, 150, 150], atol=ANGLE_SPREAD + 1e-9)


def test_lamps_lie_on_no_lattice() -> None:
    from facestage_blender.synthetic.cases.lamps import light_stage
    from facestage_blender.synthetic.cases.recipe import RECIPES

    lattice = fibonacci_stage().position
    for index, each in enumerate(RECIPES):
        position = light_stage(each.lamps, np.random.default_rng(index)).position
        nearest = np.linalg.norm(position[:, None] - lattice[None], axis=2).min(axis=1)
        assert nearest.max() > 0.05, each.name


def test_skin_is_what_the_recipe_says(model: FaceModel) -> None:

    plain = recipe("soft_many")
    usual = person_of(model, plain, 5).albedo
    changes: dict[str, dict[str, Any]] = {
        "mottle": {"mottle": 0.12},
        "freckles": {"freckles": True},
        "beard": {"beard": True},
        "shade": {"shade": 0.5},
        "dark": {"melanin": 2.0},
        "light": {"melanin": -2.0},
    }
    changed = {
        name: person_of(model, replace(plain, **change), 5).albedo
        for name, change in changes.items()
    }
    assert changed["mottle"].std() > usual.std()
    assert (changed["freckles"] <= usual).all()
    assert 0.01 < (changed["freckles"] < 0.85 * usual).any(axis=2).mean() < 0.2
    np.testing.assert_allclose(changed["shade"], np.clip(usual * 0.5, 0.005, 0.95), rtol=1e-5)
    assert changed["dark"].mean() < 0.8 * changed["light"].mean()
    assert person_of(model, recipe("oily_skin"), 5).roughness == 0.25


def test_a_beard_grows_around_the_mouth_only(model: FaceModel) -> None:
    from facestage_blender.synthetic.cases.skin import beard_weight

    weight = beard_weight(model)
    assert ((weight >= 0) & (weight <= 1)).all()
    corners, weights = model.landmark_vertices("ibug68")
    at = (weights * weight[corners]).sum(axis=1)
    assert at[[6, 8, 10]].min() > 0.5  # the chin
    assert at[17:].max() < 0.2  # brows, nose, eyes and lips
    eyes = np.concatenate([model.regions["eye_left"], model.regions["eye_right"]])
    assert not weight[eyes].any()


@pytest.mark.parametrize("kind", OCCLUDERS)
@pytest.mark.parametrize("seed", range(3))
def test_what_is_worn_lies_on_the_skin(model: FaceModel, kind: str, seed: int) -> None:
    from mathutils.bvhtree import BVHTree

    person = person_of(model, recipe(kind), seed)
    (item,) = person.worn
    vertices = model.shape(person.identity, person.expression)
    skin = BVHTree.FromPolygons(
        vertices.tolist(), model.triangles[model.triangle_part == 0].tolist()
    )
    brows = landmarks_of(model, vertices)[17:27]
    distances = []
    for point in item.vertices[:: max(1, len(item.vertices) // 2000)]:
        surface, normal, _, _ = skin.find_nearest(point.tolist())
        distances.append((np.array(surface) - point) @ -np.array(normal))
    above = np.array(distances)
    assert np.isfinite(item.vertices).all()
    assert item.triangles.max() < len(item.vertices)
    if kind == "glasses":
        assert above.min() > 0.0
        assert np.abs(item.vertices[:, 0]).max() < 0.11
        assert item.vertices[:, 2].max() < landmarks_of(model, vertices)[30, 2] + 0.01
    else:
        # The brim starts inside the head.
        assert np.mean(above > 0) > (0.9 if kind == "cap" else 0.99)
        assert item.vertices[:, 1].max() > vertices[:, 1].max()
        assert item.vertices[:, 1].min() > brows[:, 1].min() - 0.04


@pytest.mark.parametrize("seed", range(2))
def test_a_hand_leans_on_a_cheek(model: FaceModel, seed: int) -> None:
    from mathutils.bvhtree import BVHTree

    person = person_of(model, recipe("hand"), seed)
    (hand,) = person.worn
    vertices = model.shape(person.identity, person.expression)
    marks, skin = landmarks_of(model, vertices), model.triangles[model.triangle_part == 0]
    # One closed surface, before the cheek of one side, of the face's own color.
    edges = np.sort(hand.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    side = np.sign(hand.vertices[:, 0].mean())
    cheek = marks[[3, 4, 48]] if side < 0 else marks[[13, 12, 54]]
    tree = BVHTree.FromPolygons(hand.vertices.tolist(), hand.triangles.tolist())
    middle = cheek.mean(axis=0)
    hits = [
        tree.ray_cast((middle[0] + dx, middle[1] + dy, 1.0), (0, 0, -1))[0]
        for dx in np.linspace(-0.03, 0.03, 7)
        for dy in np.linspace(-0.03, 0.03, 7)
    ]
    assert sum(hit is not None for hit in hits) > 15
    face = BVHTree.FromPolygons(vertices.tolist(), skin.tolist())
    behind = [
        (hit, face.ray_cast((hit.x, hit.y, 1.0), (0, 0, -1))[0]) for hit in hits if hit is not None
    ]
    assert np.mean([surface is None or hit.z > surface.z for hit, surface in behind]) > 0.9
    np.testing.assert_allclose(
        hand.color, np.median(person.albedo.reshape(-1, 3), axis=0), rtol=0.1
    )
    assert np.ptp(hand.vertices, axis=0).max() < 0.4


def test_walls_stand_where_no_lamp_does() -> None:
    from facestage_blender.synthetic.cases.lamps import light_stage
    from facestage_blender.synthetic.cases.recipe import RECIPES
    from facestage_blender.synthetic.cases.surroundings import walls

    walled = [each for each in RECIPES if each.walls is not None]
    assert walled
    for each in walled:
        behind, beside = walls(known(each.walls), each.lamps)
        assert behind.vertices[:, 2].max() < -0.2
        x, forward = beside.vertices[0, 0], beside.vertices[:, 2].max()
        for position in light_stage(each.lamps, np.random.default_rng(0)).position:
            # The straight line from the lamp to the face's centre passes the wall's plane in front
            # of it, or never.
            assert (
                position[0] * x <= 0
                or abs(position[0]) < abs(x)
                or position[2] * x / position[0] > forward
            )


def test_a_sensor_counts_electrons() -> None:
    from facestage_blender.synthetic.photograph import READ_NOISE, noisy

    picture = np.full((200, 200, 3), 0.25)
    assert noisy(picture, None, np.random.default_rng(0)) is picture
    counted = noisy(picture, 400, np.random.default_rng(0))
    assert counted.mean() == pytest.approx(0.25, rel=2e-3)
    assert counted.std() == pytest.approx(np.sqrt(0.25 * 400 + READ_NOISE**2) / 400, rel=0.02)


def test_a_snapshot_has_all_of_it(scene, model: FaceModel, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.photograph import render_person
    from facestage_blender.synthetic.sightlines import BACKGROUND, FACE, HEAD, NARROW_FACE, WORN

    person = person_of(model, recipe("snapshot"), 3)
    assert [item.name for item in person.worn] == ["Strands", "Hand"] and len(person.around) == 2
    render_person(scene, model, person, tmp_path / "case", samples=2, seed=1, size=SIZE)
    folder = tmp_path / "case"
    truth = read_arrays(folder / "truth.npz", "truth")
    photo, compressed = (read_pixels(folder / f"photo.{kind}")[..., :3] for kind in ("png", "jpg"))
    np.testing.assert_array_equal(photo, compressed)
    exact = read_pixels(folder / "photo.exr")[..., :3]
    # The walls are orange, and no part of what the exposure was measured on.
    wall = exact[truth["labels"] == BACKGROUND].mean(axis=0)
    assert (
        wall[0] > 2 * wall[1] > 2 * wall[2]
        and not truth["mask"][truth["labels"] == BACKGROUND].any()
    )
    skin = read_pixels(folder / "skin.png")[..., 0] > 0.5
    np.testing.assert_array_equal(skin, np.isin(truth["labels"], (NARROW_FACE, FACE, HEAD)))
    assert (truth["labels"] == WORN).mean() > 0.03
    lens = scene.camera.data.dof
    assert (
        lens.use_dof
        and lens.aperture_fstop == pytest.approx(2.8)
        and 0.6 < lens.focus_distance < 0.8
    )
    assert known(Case("snapshot", folder, "default").job().camera).width == SIZE


def test_sightlines_see_what_lies_before_the_head(head: FaceModel) -> None:
    from facestage_blender.synthetic.sightlines import BACKGROUND, WORN, Sightlines

    camera = Camera.default(64, 64, 150.0)
    vertices = head.vertices + np.array([0, 0, -0.78])
    card = np.array(
        [[-0.02, -0.02, -0.5], [0.02, -0.02, -0.5], [0.02, 0.02, -0.5], [-0.02, 0.02, -0.5]]
    )
    free, hidden = (
        Sightlines(head, vertices),
        Sightlines(head, vertices, [(card, np.array([[0, 1, 2], [0, 2, 3]]))]),
    )
    left, right = camera.project(card)[:2, 0]
    labels = hidden.picture(camera)
    assert (labels == WORN).sum() == round(right - left) ** 2
    np.testing.assert_array_equal(labels[labels != WORN], free.picture(camera)[labels != WORN])
    assert labels[0, 0] == BACKGROUND
    points = landmarks_of(head, vertices)
    assert free.visible(points).all()
    behind = (np.abs(camera.project(points) - 32) < (right - left) / 2).all(axis=1)
    assert behind.any()
    np.testing.assert_array_equal(hidden.visible(points), ~behind)


def test_truth_shows_the_albedo_of_the_face_tile(head: FaceModel) -> None:
    from facestage_blender.synthetic.photograph import face_tile

    texture = np.random.default_rng(2).uniform(size=(64, 64, 3))
    model = replace(head, face_tile=(0.25, 0.125, 0.5))
    uvs = np.random.default_rng(3).uniform(0.05, 0.95, (200, 2))
    tile = face_tile(texture, model)
    assert tile.shape == (32, 32, 3)
    np.testing.assert_allclose(
        sample_bilinear(tile, uvs),
        sample_bilinear(texture, np.array([0.25, 0.125]) + 0.5 * uvs),
        atol=1e-9,
    )


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
    truth = Truth(tmp_path / "a" / "hard_side" / "truth.npz", FaceGeometry(head))
    assert truth.albedo_error(truth.arrays["albedo"]) == pytest.approx(0, abs=1e-6)  # float32
    # The stage's own lattice cannot give this light.
    assert known(truth.light_error(fibonacci_stage(), truth.vertices.mean(0))) > 0.1
    assert len(truth.arrays["light_position"]) == 2
    assert main([*order, "--out", str(tmp_path / "b")]) == 0
    for name in ("photo.png", "landmarks.json", "camera.json"):
        assert (tmp_path / "a/hard_side" / name).read_bytes() == (
            tmp_path / "b/hard_side" / name
        ).read_bytes()


@pytest.mark.parametrize("kind", OCCLUDERS)
def test_what_is_worn_hides_the_face(scene, model: FaceModel, kind: str, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.photograph import render_person
    from facestage_blender.synthetic.sightlines import WORN

    person = person_of(model, recipe(kind), 1)
    render_person(scene, model, person, tmp_path / "case", samples=4, seed=1, size=2 * SIZE)
    truth = read_arrays(tmp_path / "case" / "truth.npz", "truth")
    worn = truth["labels"] == WORN
    assert 0.005 < worn.mean() < 0.3
    assert not truth["mask"][worn].any()
    photo = read_pixels(tmp_path / "case" / "photo.exr")[..., :3]
    assert 0.7 < np.percentile(photo[truth["mask"]], 99) < 1.0
    # It is the render that shows it there: its color is not the skin's.
    share = photo / np.maximum(photo.sum(axis=2, keepdims=True), 1e-6)
    difference = np.abs(share[worn].mean(axis=0) - share[truth["mask"]].mean(axis=0)).max()
    assert difference > 0.02
    landmarks = Landmarks.read(tmp_path / "case" / "landmarks.json")
    if kind == "fringe":
        assert not landmarks.visible[17:27].all()
    assert landmarks.visible[28:36].all()
