"""The default head: counts and names, a sound mesh and atlas, published measurements, well-behaved
deformations.
"""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from facestage.contract.arkit import ARKIT_NAMES
from facestage.contract.face_model import EYES, MOUTH, SKIN, TEETH, FaceModel
from facestage.models.head import mouth
from facestage.models.head.anthropometry import MEASUREMENTS
from facestage.models.head.assemble import assemble
from facestage.models.head.coloring import hair_weight
from facestage.models.head.default_head import build_default_model
from facestage.models.head.masks import Masks
from facestage.models.head.measuring import measured

MM = 1e-3


@cache
def model() -> FaceModel:
    return build_default_model()


@cache
def mirror() -> np.ndarray:
    """The vertex on the other side of each vertex."""
    distance, index = cKDTree(model().vertices).query(model().vertices * [-1, 1, 1])
    assert distance.max() < 1e-6
    # Where two vertices coincide (the meeting lips) the nearest may be the wrong one of them.
    return index


def landmarks() -> np.ndarray:
    index, weights = model().landmark_vertices("ibug68")
    return np.einsum("lkc,lk->lc", model().vertices[index].astype(float), weights)


def expression(**weights: float) -> np.ndarray:
    vector = np.zeros(len(model().expression_names))
    for name, weight in weights.items():
        vector[model().expression_names.index(name)] = weight
    return model().shape(None, vector)


def normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[triangles[:, k]].astype(float) for k in range(3))
    return np.cross(b - a, c - a) / 2


def part_triangles(part: int) -> np.ndarray:
    return model().triangles[model().triangle_part == part]


def face_triangles() -> np.ndarray:
    inside = np.zeros(len(model().vertices), bool)
    inside[model().regions["face"]] = True
    triangles = part_triangles(SKIN)
    return triangles[inside[triangles].all(axis=1)]


def test_sizes_and_names():
    m = model()
    assert 5000 <= len(m.vertices) <= 12000
    assert (m.polygons[:, 3] >= 0).mean() > 0.95
    assert len(m.identity_names) == len(set(m.identity_names)) == 80
    assert len(m.expression_names) == len(set(m.expression_names)) == 90
    assert m.expression_names[:52] == ARKIT_NAMES and len(ARKIT_NAMES) == 52
    assert len(m.albedo_basis) == 80
    assert m.expression_prior == "box"
    assert set(np.unique(m.polygon_part)) == {SKIN, EYES, MOUTH, TEETH}
    wanted = {
        "narrow_face",
        "face",
        "skin",
        "eye_left",
        "eye_right",
        "lips",
        "scalp",
        "neck",
        "brows",
        "ears",
        "eye_corners",
    }
    assert wanted <= set(m.regions)
    assert all(len(m.regions[name]) > 20 for name in wanted)
    assert all(np.abs(basis).max() > 0.3 * MM for basis in m.identity_basis)
    assert all(np.abs(basis).max() > 0.5 * MM for basis in m.expression_basis)


def test_frame():
    m = model()
    narrow = m.vertices[m.regions["narrow_face"]]
    np.testing.assert_allclose(narrow.mean(axis=0), 0, atol=2e-4)
    assert (
        m.vertices[m.regions["eye_left"], 0].mean()
        > 0
        > m.vertices[m.regions["eye_right"], 0].mean()
    )
    points = landmarks()
    assert points[30, 2] == points[:, 2].max(), "the nose tip points along +Z"
    assert points[27, 1] > points[8, 1]
    assert 0.2 < np.ptp(m.vertices[:, 1]) < 0.4


def test_building_again_gives_the_same_model():
    first, second = model(), build_default_model.__wrapped__()
    for name in (
        "vertices",
        "polygons",
        "uvs",
        "identity_basis",
        "expression_basis",
        "albedo_mean",
        "albedo_basis",
    ):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_survives_a_round_trip_through_a_file(tmp_path):
    model().save(tmp_path / "head.npz")
    loaded = FaceModel.load(tmp_path / "head.npz")
    np.testing.assert_array_equal(loaded.vertices, model().vertices)
    assert loaded.expression_names == model().expression_names


def test_mesh_is_manifold_with_consistent_outward_normals():
    m = model()
    for part in (SKIN, EYES, MOUTH, TEETH):
        triangles = part_triangles(part)
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        _, counts = np.unique(edges, axis=0, return_counts=True)
        assert counts.max() == 1, "two triangles run along an edge in the same direction"
    area = normals(m.vertices, face_triangles())
    center = m.vertices[face_triangles()].mean(axis=1) - [0, 0, -0.09]
    assert (np.einsum("ij,ij->i", area, center) > 0).mean() > 0.98
    for side in ("left", "right"):
        eye = m.regions[f"eye_{side}"]
        triangles = part_triangles(EYES)
        triangles = triangles[np.isin(triangles[:, 0], eye)]
        outward = m.vertices[triangles].mean(axis=1) - m.vertices[eye].mean(axis=0)
        assert (np.einsum("ij,ij->i", normals(m.vertices, triangles), outward) > 0).all()


def test_skin_is_one_piece_whose_only_open_edges_are_neck_eyes_and_mouth():
    triangles = part_triangles(SKIN)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    directed = {tuple(edge) for edge in edges}
    successor = {a: b for a, b in directed if (b, a) not in directed}
    loops = 0
    while successor:
        start, following = successor.popitem()
        while following != start:
            following = successor.pop(following)
        loops += 1
    assert loops == 4


def test_no_degenerate_polygons():
    m = model()
    area = np.linalg.norm(normals(m.vertices, m.triangles), axis=1)
    assert area.min() > 1e-4 * MM**2
    quads = m.polygons[m.polygons[:, 3] >= 0]
    assert (np.sort(quads, axis=1)[:, 1:] != np.sort(quads, axis=1)[:, :-1]).all()


def uv_area(triangle_uvs: np.ndarray) -> np.ndarray:
    corner = model().uvs[triangle_uvs].astype(float)
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2


def test_atlas_fills_the_square_without_folds():
    m = model()
    assert m.uvs.min() >= 0 and m.uvs.max() <= 1
    area = uv_area(m.triangle_uvs)
    assert (area > 0).mean() > 0.9999
    inside = np.zeros(len(m.vertices), bool)
    inside[m.regions["face"]] = True
    skin = m.triangle_part == SKIN
    face = skin & inside[m.triangles].all(axis=1)
    assert (area[face] > 0).all()
    assert area[skin].sum() > 0.75


def test_atlas_has_no_overlap():
    """Random points of the square lie in one triangle at most."""
    m = model()
    corner = m.uvs[m.triangle_uvs].astype(float)
    points = np.random.default_rng(0).random((400, 2))
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]

    def side(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return (q - p)[None, :, 0] * (points[:, None, 1] - p[None, :, 1]) - (q - p)[None, :, 1] * (
            points[:, None, 0] - p[None, :, 0]
        )

    inside = (side(a, b) > 1e-12) & (side(b, c) > 1e-12) & (side(c, a) > 1e-12)
    assert inside.sum(axis=1).max() == 1


def test_face_has_no_seam():
    m = model()
    inside = np.zeros(len(m.vertices), bool)
    inside[m.regions["face"]] = True
    corners = np.stack([m.triangles.ravel(), m.triangle_uvs.ravel()], axis=-1)
    keep = np.repeat(m.triangle_part == SKIN, 3) & inside[corners[:, 0]]
    pairs = np.unique(corners[keep], axis=0)
    assert len(np.unique(pairs[:, 0])) == len(pairs)


def test_mean_is_symmetric():
    m = model()
    np.testing.assert_allclose(m.vertices[mirror()] * [-1, 1, 1], m.vertices, atol=2e-6)
    np.testing.assert_allclose(m.albedo_mean[mirror()], m.albedo_mean, atol=0.06)


def test_modes_are_symmetric_unless_named_otherwise():
    m = model()
    flipped = m.identity_basis[:, mirror()] * [-1, 1, 1]
    for name, basis, other in zip(m.identity_names, m.identity_basis, flipped, strict=True):
        difference = np.abs(basis - other).max()
        if "asymmetry" in name:
            assert difference > 0.3 * MM, name
        else:
            assert difference < 0.02 * MM, name


def test_left_and_right_expressions_mirror_each_other():
    m = model()
    for name in m.expression_names:
        other = name.replace("Left", "Right") if "Left" in name else name.replace("_left", "_right")
        if other == name or name in ("eyeLookInLeft", "eyeLookOutLeft"):
            continue
        a = m.expression_basis[m.expression_names.index(name)]
        b = m.expression_basis[m.expression_names.index(other)]
        mismatch = np.linalg.norm(a[mirror()] * [-1, 1, 1] - b, axis=1)
        # Coinciding vertices of the two lips may be taken for each other.
        assert (mismatch > 0.05 * MM).sum() < 60, name


def test_landmarks_are_symmetric_and_sensible():
    points = landmarks()
    swap = np.r_[
        np.arange(17)[::-1], np.arange(17, 27)[::-1], np.arange(27, 31), np.arange(31, 36)[::-1],
        45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40,
        54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55, 64, 63, 62, 61, 60, 67, 66, 65,
    ]  # fmt: skip
    np.testing.assert_allclose(points[swap] * [-1, 1, 1], points, atol=0.2 * MM)
    assert (np.diff(points[:17, 0]) > 0).all(), "the jaw runs from the subject's right to the left"
    assert points[8, 1] == points[:, 1].min()
    assert (points[17:27, 1] > points[36:48, 1].max()).all(), "brows above eyes"
    assert points[37, 1] > points[41, 1] and points[44, 1] > points[46, 1], (
        "upper lid above lower lid"
    )
    assert points[36, 0] < points[39, 0] < 0 < points[42, 0] < points[45, 0]
    # The lower lip is hidden a little by the upper one's bow.
    assert points[51, 1] > points[62, 1] >= points[66, 1] - 0.5 * MM > points[57, 1]
    assert len(np.unique(model().landmark_vertices("ibug68")[0][:, 0])) == 68


def test_brow_landmarks_follow_the_middle_of_the_hair():
    m = model()
    points = landmarks()[22:27] / MM
    hair = m.vertices[m.regions["brows"]] / MM
    hair = hair[hair[:, 0] > 0]
    assert hair[:, 0].min() == pytest.approx(points[0, 0], abs=4) and hair[
        :, 0
    ].max() == pytest.approx(points[4, 0], abs=4)
    for point in points[1:4]:
        here = hair[np.abs(hair[:, 0] - point[0]) < 3]
        assert point[1] == pytest.approx(0.5 * (here[:, 1].min() + here[:, 1].max()), abs=1.2)
    assert points[:, 1].argmax() in (2, 3), "highest over the outer half"
    assert abs(points[0, 1] - points[4, 1]) < 5, "level, not drooping outward"


def test_jaw_landmarks_lie_on_the_outline_seen_from_the_front():
    m = model()
    skin = m.vertices[np.setdiff1d(m.regions["face"], m.regions["ears"])] / MM
    for point in landmarks()[11:17] / MM:
        level = skin[np.abs(skin[:, 1] - point[1]) < 2]
        assert point[0] == pytest.approx(level[:, 0].max(), abs=4), point


def test_ears_move_as_a_whole():
    """The breadth of the head does not spread the upper rim of the ears: at two deviations by less
    than 8 mm.
    """
    m = model()
    ear = m.regions["ears"][m.vertices[m.regions["ears"], 0] > 0]
    for name, basis in zip(m.identity_names, m.identity_basis, strict=True):
        spread = np.ptp(basis[ear, 0]) / MM
        assert 2 * spread < 8, f"{name}: {2 * spread:.1f} mm"


# Named here, so that no head is built while the tests are collected.
MEASURED = (
    "bigonial_breadth",
    "bizygomatic_breadth",
    "ear_length",
    "eye_fissure_length",
    "head_breadth",
    "head_length",
    "interpupillary_distance",
    "lip_length",
    "menton_sellion_length",
    "nose_breadth",
    "nose_protrusion",
    "subnasale_sellion_length",
)


def test_everything_measured_is_compared():
    assert sorted(measured(model())) == sorted(MEASURED)


@pytest.mark.parametrize("name", MEASURED)
def test_mean_has_published_measurements(name):
    published = MEASUREMENTS[name]
    value = measured(model())[name]
    assert abs(value - published.mean) < 0.75 * published.sd, (
        f"{name}: {value:.1f} mm, published {published}"
    )


def test_identity_modes_change_their_measurement_by_the_published_deviation():
    points = landmarks()
    index = model().landmark_vertices("ibug68")[0][:, 0]

    def change(name: str, a: int, b: int) -> float:
        moved = points + model().identity_basis[model().identity_names.index(name)][index]
        return (
            float(np.linalg.norm(moved[a] - moved[b]) - np.linalg.norm(points[a] - points[b])) / MM
        )

    assert change("face_height", 27, 8) == pytest.approx(
        MEASUREMENTS["menton_sellion_length"].sd, rel=0.15
    )
    assert change("mouth_width", 48, 54) == pytest.approx(MEASUREMENTS["lip_length"].sd, rel=0.25)
    assert change("nose_length", 27, 33) == pytest.approx(
        MEASUREMENTS["subnasale_sellion_length"].sd, rel=0.2
    )


def test_eyeballs_move_rigidly_with_every_identity_mode():
    m = model()
    for side in ("left", "right"):
        eye = m.regions[f"eye_{side}"]
        moves = m.identity_basis[:, eye]
        np.testing.assert_allclose(moves, np.broadcast_to(moves[:, :1], moves.shape), atol=1e-7)


def test_random_people_have_no_flipped_face_triangles():
    m = model()
    triangles = face_triangles()
    rest = normals(m.vertices, triangles)
    rng = np.random.default_rng(7)
    for person in range(10):
        alpha = rng.standard_normal(80)
        area = normals(m.shape(alpha), triangles)
        agreement = np.einsum("ij,ij->i", area, rest)
        assert (agreement > 0).all(), f"person {person}: {(agreement <= 0).sum()} flipped triangles"


def eye_gap(vertices: np.ndarray, right: bool) -> float:
    """Mean distance in mm between the landmarks of the upper and the lower lid."""
    index = model().landmark_vertices("ibug68")[0][:, 0]
    start = 36 if right else 42
    upper, lower = vertices[index[[start + 1, start + 2]]], vertices[index[[start + 5, start + 4]]]
    return float(np.linalg.norm(upper - lower, axis=1).mean() / MM)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_blink_closes_the_lids_over_the_eyeball(side):
    m = model()
    right = side == "Right"
    assert eye_gap(m.vertices, right) > 5
    assert eye_gap(expression(**{f"eyeBlink{side}": 1.0}), right) < 0.4
    assert eye_gap(expression(**{f"eyeBlink{side}": 1.0}), not right) > 5
    eye = m.vertices[m.regions[f"eye_{side.lower()}"]].astype(float)
    center, radius = eye.mean(axis=0), 0.0
    center = 0.5 * (eye.min(axis=0) + eye.max(axis=0))
    radius = np.linalg.norm(eye - center, axis=1).mean()
    face = np.zeros(len(m.vertices), bool)
    face[m.regions["face"]] = True
    for weight in (0.0, 0.25, 0.5, 0.75, 1.0):
        lids = expression(**{f"eyeBlink{side}": weight})[face]
        nearest = np.linalg.norm(lids - center, axis=1).min()
        assert nearest > radius - 0.1 * MM, (
            f"at weight {weight} a lid is {(radius - nearest) / MM:.2f} mm in the eye"
        )


def test_lips_rest_closed_and_the_jaw_opens_them():
    index = model().landmark_vertices("ibug68")[0][:, 0]

    def gap(vertices: np.ndarray) -> float:
        return float((vertices[index[62], 1] - vertices[index[66], 1]) / MM)

    assert -0.5 < gap(model().vertices) < 0.3
    assert gap(expression(jawOpen=1.0)) > 25
    assert abs(gap(expression(jawOpen=1.0, mouthClose=1.0))) < 4
    teeth = np.unique(part_triangles(TEETH))
    fallen = (model().vertices - expression(jawOpen=1.0))[teeth, 1] / MM
    assert (fallen > 20).any() and (fallen < 0.01).any(), (
        "lower teeth follow the jaw, upper teeth stay"
    )


def test_the_lower_lip_has_no_notch_where_the_upper_one_has_its_bow():
    """It runs on behind that, and without a corner in the middle when lips part."""
    meeting = assemble().loops["mouth"][mouth.LIP_LOOPS]
    half = len(meeting) // 2
    lower, upper = meeting[1:half], meeting[:half:-1]
    near = np.abs(model().vertices[lower, 0]) < 7 * MM
    over, under = (model().vertices[row][near].astype(float) / MM for row in (upper, lower))
    middle = np.abs(under[:, 0]).argmin()
    assert np.ptp(over[:, 1]) > 0.5 and over[middle, 1] < under[middle, 1]
    assert under[middle, 2] < over[middle, 2] - 0.3
    for shape in (
        model().vertices,
        expression(jawOpen=0.4, mouthSmileLeft=0.5, mouthSmileRight=0.5),
    ):
        height = shape[lower][near, 1] / MM
        straight = np.polyval(np.polyfit(under[:, 0], height, 2), under[:, 0])
        print(f"{np.abs(height - straight).max():.2f} mm beside a curve")
        assert np.abs(height - straight).max() < 0.16


def test_eye_look_turns_the_eyeballs():
    for name, axis, sign in (
        ("eyeLookUpLeft", 1, 1),
        ("eyeLookDownLeft", 1, -1),
        ("eyeLookOutLeft", 0, 1),
    ):
        eye = model().regions["eye_left"]
        pupil = eye[model().vertices[eye, 2].argmax()]
        moved = expression(**{name: 1.0})[pupil] - model().vertices[pupil]
        assert sign * moved[axis] > 3 * MM, name


def test_expressions_are_distinct():
    flat = model().expression_basis.reshape(90, -1).astype(float)
    unit = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    cosine = unit @ unit.T - np.eye(90)
    a, b = np.unravel_index(cosine.argmax(), cosine.shape)
    assert cosine.max() < 0.97, f"{model().expression_names[a]} and {model().expression_names[b]}"


def test_albedo():
    m = model()
    assert m.albedo_mean.min() > 0 and m.albedo_mean.max() < 1
    rng = np.random.default_rng(3)
    albedo = m.albedo(rng.standard_normal(80))
    assert albedo.min() > 0 and albedo.max() < 1
    off_skin = np.setdiff1d(np.arange(len(m.vertices)), m.regions["skin"])
    assert (m.albedo_basis[:, off_skin] == 0).all()
    cheek = m.albedo_mean[m.regions["narrow_face"]].mean(axis=0)
    brow = m.albedo_mean[m.regions["brows"]].mean(axis=0)
    lips = m.albedo_mean[m.regions["lips"]].mean(axis=0)
    assert cheek[0] > cheek[1] > cheek[2]
    assert brow.mean() < 0.7 * cheek.mean()
    assert lips[0] / lips[1] > 1.2 * cheek[0] / cheek[1]


def test_ears_are_a_little_redder_than_the_skin_beside_them():
    m = model()
    ears, face = m.regions["ears"], np.setdiff1d(m.regions["face"], m.regions["ears"])
    away = cKDTree(m.vertices[ears]).query(m.vertices[face])[0]
    beside = face[(away > 5 * MM) & (away < 30 * MM)]
    ear, cheek = (np.median(np.log(m.albedo_mean[each]), axis=0) for each in (ears, beside))
    redder, darker = (ear - cheek)[0] - (ear - cheek)[1], (cheek - ear).mean()
    print(f"ears: log red over green {redder:.3f} above the cheek's, darker by {darker:.3f}")
    assert 0.02 < redder < 0.07
    assert darker < 0.07


def test_hair_thins_without_an_edge():
    """From the scalp to the skin in steps that no one sees, also beside the ears."""
    masks = Masks(assemble())
    weight = hair_weight(masks)
    polygons = masks.mesh.polygons[masks.mesh.polygon_part == SKIN]
    a, b = polygons[:, :2], polygons[:, 1:3]
    length = np.linalg.norm(masks.points[a] - masks.points[b], axis=-1)
    steepest = (np.abs(weight[a] - weight[b]) / np.maximum(length, 1.0)).max()
    print(f"hair thins by {steepest:.3f} per mm at most")
    assert weight.max() > 0.95
    assert weight.min() > -1e-6
    assert steepest < 0.07
