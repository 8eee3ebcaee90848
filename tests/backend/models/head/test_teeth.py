"""The teeth of the default head: hidden behind closed lips, shown by a smile, of natural size."""

from functools import cache

import numpy as np
import pytest

from facestage.contract.face_model import MOUTH, SKIN, TEETH, FaceModel
from facestage.models.head import mouth, teeth
from facestage.models.head.assemble import HeadMesh, assemble
from facestage.models.head.default_head import build_default_model

MM = 1e-3


@cache
def model() -> FaceModel:
    return build_default_model()


@cache
def mesh() -> HeadMesh:
    return assemble()


def shape(**weights: float) -> np.ndarray:
    """(n, 3) mm; a name without its side means both sides."""
    vector = np.zeros(len(model().expression_names))
    for stem, weight in weights.items():
        names = [n for n in model().expression_names if n in (stem, stem + "Left", stem + "Right")]
        names += [n for n in model().expression_names if n in (stem + "_left", stem + "_right")]
        assert names, stem
        vector[[model().expression_names.index(n) for n in names]] = weight
    return model().shape(None, vector).astype(np.float64) / MM


def seen(vertices: np.ndarray, yaw: float = 0.0) -> np.ndarray:
    """(m, 3) points on the teeth that nothing soft hides from a distant camera at `yaw` degrees, in
    its frame.
    """
    angle = np.radians(yaw)
    to_camera = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    vertices = vertices @ to_camera.T
    triangles = model().triangles[model().triangle_part == TEETH]
    center = vertices[triangles].mean(axis=1)
    corner = vertices[triangles]
    facing = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] > 0
    points = center[facing]
    cover = vertices[model().triangles[np.isin(model().triangle_part, (SKIN, MOUTH))]]
    low, high = points.min(axis=0) - 1, points.max(axis=0) + 1
    near = (cover[..., :2].max(axis=1) > low[:2]).all(axis=1) & (
        cover[..., :2].min(axis=1) < high[:2]
    ).all(axis=1)
    return points[~hidden(points, cover[near & (cover[..., 2].max(axis=1) > low[2])])]


def hidden(points: np.ndarray, cover: np.ndarray) -> np.ndarray:
    """(m,) whether any of the triangles (t, 3, 3) lies in front of the points (m, 3), along +z."""
    result = np.zeros(len(points), bool)
    for a, b, c in cover:
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-9:
            continue
        p = points[:, :2] - a[:2]
        v = (p[:, 0] * (c[1] - a[1]) - p[:, 1] * (c[0] - a[0])) / area
        w = ((b[0] - a[0]) * p[:, 1] - (b[1] - a[1]) * p[:, 0]) / area
        depth = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
        result |= (v >= -1e-6) & (w >= -1e-6) & (v + w <= 1 + 1e-6) & (depth > points[:, 2])
    return result


def outside_opening(
    points: np.ndarray, vertices: np.ndarray, yaw: float, margin: float
) -> np.ndarray:
    """Those of the seen points (m, 3) further than `margin` mm outside the opening between the
    lips.
    """
    angle = np.radians(yaw)
    ring = vertices[mesh().loops["mouth"][mouth.LIP_LOOPS]]
    ring = np.stack([np.cos(angle) * ring[:, 0] - np.sin(angle) * ring[:, 2], ring[:, 1]], axis=-1)
    start, end = ring, np.roll(ring, -1, axis=0)
    p = points[:, None, :2]
    crosses = (start[:, 1] > p[..., 1]) != (end[:, 1] > p[..., 1])
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    at = start[:, 0] + (p[..., 1] - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
    inside = (crosses & (p[..., 0] < at)).sum(axis=1) % 2 == 1
    axis = end - start
    along = np.clip(((p - start) * axis).sum(-1) / np.maximum((axis**2).sum(-1), 1e-12), 0, 1)
    distance = np.linalg.norm(p - start - along[..., None] * axis, axis=-1).min(axis=1)
    return points[~inside & (distance > margin)]


@pytest.mark.parametrize("yaw", [-40.0, 0.0, 40.0])
def test_closed_lips_hide_the_teeth(yaw):
    """All but what shows through the slit of some hundredths of a millimetre along which the lips
    meet.
    """
    vertices = shape()
    points = seen(vertices, yaw)
    assert len(points) < 3 and len(outside_opening(points, vertices, yaw, 0.1)) == 0


COMBINATIONS = (
    {"mouthSmile": 1.0},
    {"mouthSmile": 0.4, "jawOpen": 0.5},
    {"mouthSmile": 1.0, "jawOpen": 0.3},
    {"mouthRollUpper": 1.0},
    {"mouthRollLower": 1.0},
    {"mouthRollUpper": 1.0, "mouthRollLower": 1.0},
    {"viseme_M": 1.0},
    {"viseme_F": 1.0},
    {"mouthPress": 1.0},
    {"mouthStretch": 1.0},
    {"mouthDimple": 1.0},
    {"mouthFrown": 1.0},
    {"AU35_cheek_suck": 1.0},
    {"AU23_lip_tightener": 1.0},
    {"mouthLeft": 1.0},
    {"jawLeft": 1.0},
    {"jawForward": 1.0},
    {"jawOpen": 1.0},
    {"mouthUpperUp": 1.0, "mouthLowerDown": 1.0},
    {"mouthSmile": 0.7, "mouthDimple": 0.7},
    {"jawOpen": 1.0, "mouthClose": 1.0},
    {"AU13_sharp_lip_puller": 1.0},
    {"mouthPucker": 1.0},
    {"jaw_back": 1.0},
)


@pytest.mark.parametrize("weights", COMBINATIONS, ids=lambda w: "+".join(w))
@pytest.mark.parametrize("yaw", [0.0, 35.0])
def test_teeth_show_only_between_the_lips(weights, yaw):
    vertices = shape(**weights)
    through = outside_opening(seen(vertices, yaw), vertices, yaw, 0.6)
    assert len(through) == 0, (
        f"{len(through)} points of teeth come through skin, first {through[:3]}"
    )


def test_rolled_and_pressed_lips_hide_the_teeth():
    for weights in (
        {"mouthRollUpper": 1.0, "mouthRollLower": 1.0},
        {"mouthPress": 1.0},
        {"viseme_M": 1.0},
    ):
        assert len(seen(shape(**weights))) == 0, weights


def shown_height(vertices: np.ndarray) -> float:
    """How much of the upper central incisors shows from the front, mm."""
    points = seen(vertices)
    edge = vertices[mesh().teeth["upper"], 1].min()
    points = points[(np.abs(points[:, 0]) < 7) & (points[:, 1] > edge - 0.2)]
    return float(np.ptp(points[:, 1])) if len(points) > 1 else 0.0


def test_a_smile_shows_the_upper_teeth():
    assert shown_height(shape(mouthSmile=1.0)) < 0.5, "lips smile closed"
    assert 2.0 < shown_height(shape(mouthSmile=1.0, mouthUpperUp=0.5)) < 6.0
    full = shown_height(shape(mouthSmile=1.0, mouthUpperUp=0.6, jawOpen=0.2, mouthLowerDown=0.4))
    assert full > 6.0
    assert 1.0 < shown_height(shape(AU25_lips_part=1.0)) < 6.0, (
        "lips parted at rest show the incisal edges"
    )
    points = seen(shape(mouthSmile=1.0, mouthUpperUp=0.5))
    assert np.ptp(points[:, 0]) > 45, "from premolar to premolar"


def test_upper_teeth_stay_when_the_jaw_drops():
    rest, opened = shape(), shape(jawOpen=1.0)
    upper, lower = mesh().teeth["upper"], mesh().teeth["lower"]
    np.testing.assert_allclose(opened[upper], rest[upper], atol=0.01)
    assert (rest - opened)[lower, 1].min() > 5


def test_teeth_have_natural_sizes():
    """Nelson and Ash 2010: crowns; 2 mm of incisor below the meeting line of the lips, lower
    incisors behind them.
    """
    rest = shape()
    upper, lower = (
        rest[mesh().teeth[row]].reshape(teeth.PROFILE, -1, 3) for row in ("upper", "lower")
    )
    arch = upper[teeth.GUM_ROWS + 1]
    assert np.ptp(arch[:, 0]) == pytest.approx(55, abs=2)
    meeting = rest[mesh().loops["mouth"][mouth.LIP_LOOPS]]
    line = meeting[np.abs(meeting[:, 0]).argmin()]
    assert 1.5 < line[1] - upper[..., 1].min() < 3.0
    middle = np.abs(arch[:, 0]) < 5
    assert upper[teeth.GUM_ROWS :, middle, 1].max() - upper[..., 1].min() == pytest.approx(
        10, abs=1
    )
    behind = upper[teeth.GUM_ROWS + 3, :, 2].max() - lower[teeth.GUM_ROWS + 3, :, 2].max()
    assert 1.0 < behind < 3.0


def crowns(row: teeth.Row, share: float) -> np.ndarray:
    """(14, COLUMNS + 1, 3) mm, from the subject's right: each crown and the gaps beside it, at the
    row of the profile whose share of the height is nearest to ``share``, gums left out.
    """
    table = np.array([each for each, _ in teeth.PROFILE_ROWS])
    table[: teeth.GUM_ROWS] = np.inf
    strip = teeth.strip(row)[0][int(np.abs(table - share).argmin())]
    first = np.arange(0, len(strip) - 1, teeth.COLUMNS)
    return strip[first[:, None] + np.arange(teeth.COLUMNS + 1)]


@pytest.mark.parametrize("row", [teeth.UPPER, teeth.LOWER], ids=["upper", "lower"])
def test_crowns_part_at_their_edges(row):
    """Each edge is rounded off towards the gaps, canines and premolars are pointed, and both sides
    are mirror images.
    """
    edge = row.away * (crowns(row, 0.0)[..., 1] - row.edge)
    np.testing.assert_allclose(edge, edge[::-1, ::-1], atol=1e-9)
    left = edge[7:]
    notches = left[:6, -1] - np.minimum(left[:6].min(axis=1), left[1:7].min(axis=1))
    assert (notches > 0.4).all() and (notches < 3.0).all()
    for tooth in (2, 3, 4):
        tip = left[tooth].argmin()
        assert 0 < tip < teeth.COLUMNS
        assert left[tooth, [1, -2]].min() - left[tooth, tip] > 0.8
    near, far = left[:3, 1] - left[:3].min(axis=1), left[:3, -2] - left[:3].min(axis=1)
    assert (far > near).all(), "rounder on the side away from the midline"


def test_notches_between_the_upper_front_teeth_grow_from_the_midline():
    left = crowns(teeth.UPPER, 0.0)[7:, :, 1] - teeth.UPPER.edge
    notch = [np.mean(left[tooth, 0] - left[tooth].min()) for tooth in range(3)]
    assert notch[0] < left[0, -1] - left[0].min() < left[1, -1] - left[1].min()


@pytest.mark.parametrize("row", [teeth.UPPER, teeth.LOWER], ids=["upper", "lower"])
def test_gums_fill_two_fifths_of_the_gaps(row):
    """Chu et al. 2009, of the front teeth; a crown's neck lies deepest in its middle."""
    strip = teeth.strip(row)[0]
    necks = row.away * (strip[teeth.GUM_ROWS, :, 1] - row.edge)
    for tooth in range(7, 13):
        first = tooth * teeth.COLUMNS
        neck = necks[first : first + teeth.COLUMNS + 1]
        height = row.crowns[tooth - 7].height
        assert 0.3 < (neck[2] - neck[-1]) / height < 0.5
        assert neck[2] > neck[1] > neck[0] and neck[3] > neck[4] > neck[5]


@pytest.mark.parametrize("row", [teeth.UPPER, teeth.LOWER], ids=["upper", "lower"])
@pytest.mark.parametrize("share", [0.2, 0.53])
def test_gaps_are_too_shallow_to_hide_from_light(row, share):
    """A shadow ray starts a fifth of a millimetre off the surface: where walls meet at less than a
    right angle that is beyond the other wall, and the gap is a black line.
    """
    front = crowns(row, share)[4:10][..., [0, 2]]
    assert angles(front[:-1, -2], front[1:, 0], front[1:, 1]).min() > 90


@pytest.mark.parametrize("row", [teeth.UPPER, teeth.LOWER], ids=["upper", "lower"])
def test_necks_are_too_shallow_to_hide_from_light(row):
    """Between the gum above and the crown below them, as the gaps are."""
    strip = teeth.strip(row)[0][:, 4 * teeth.COLUMNS : 10 * teeth.COLUMNS + 1]
    gum, neck, crown = strip[teeth.GUM_ROWS - 1 : teeth.GUM_ROWS + 2]
    assert angles(gum, neck, crown).min() > 120


def angles(before: np.ndarray, corner: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Degrees between the ways to both neighbours."""
    ways = before - corner, after - corner
    one, other = (way / np.linalg.norm(way, axis=-1, keepdims=True) for way in ways)
    return np.asarray(np.degrees(np.arccos((one * other).sum(-1))))


def test_short_lips_show_more_teeth():
    """The lip's length varies, the teeth hardly follow it."""
    mode = model().identity_basis[model().identity_names.index("upper_lip_height")] / MM
    lip = mode[mesh().loops["mouth"][mouth.LIP_LOOPS]]
    assert np.abs(mode[mesh().teeth["upper"], 1]).max() < 0.5 * np.abs(lip[:, 1]).max()
