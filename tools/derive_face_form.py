"""The form of the built-in head's face: python tools/derive_face_form.py ict:PATH

Lays the neutral face of the built-in head, as identity modes say it, on the mean face of
ICT-FaceKit: by its modes and a smooth rest, then by ever finer ones, both sides alike. What moves
the front of its face there, after a similarity of the narrow face, is written to
models/head/data/face_form.npz, which face_form.py reads; nobody else needs to run this.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import OTHER, SKIN, FaceModel
from facestage.contract.files.storage import write_arrays
from facestage.models.correspondence.registration import register
from facestage.models.correspondence.smooth_warp import smooth_displacement
from facestage.models.head import eyes, mouth
from facestage.models.head.assemble import SIDES, HeadMesh, assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.face_form import DATA, without_form
from facestage.models.head.masks import Masks, smoothstep
from facestage.models.mesh.similarity import procrustes
from facestage.models.mesh.surface import Surface, vertex_normals
from facestage.models.registry import load_model

MM = 1e-3
# Over how many mm moves resemble each other, and the least cosine of normals that belong together:
# the sides of nostrils turn away from where they began.
SCHEDULE = ((8.0, 0.5), (6.0, 0.5), (4.5, 0.4), (4.5, 0.4), (3.5, 0.3), (3.5, 0.3))
SPACING, NEAR, NOISE = 1 / 3, 4.0, 0.3  # of that reach; mm; of a move
SLIDING = 0.3  # how much of the way along the surface is gone
EYE = 15.5  # mm about an eye where another model's lids say nothing
# Lids follow the eyeball up to here, skin from there on the other model (mm from their margin).
LIDS, SOCKET = 3.0, 12.0
# Height of the lower lip's red, mm: mean of men and women (Farkas 1994, "Anthropometry of the Head
# and Face"); the upper one's is as published already.
LOWER_RED = 9.35
SMALLEST, DIGIT = 0.005, 0.001  # mm; to what the moves are rounded: lips in the middle never cross
# mm by which each lip reaches past their line beside the corners, where moved lips would part.
LAP = 0.1


def mirrored(points: np.ndarray) -> np.ndarray:
    """(n,) the vertex on the other side of each."""
    distance, index = cKDTree(points * [-1, 1, 1]).query(points)
    if distance.max() > 1e-3 * MM:
        raise SystemExit("The head is not its own mirror image.")
    return np.asarray(index)


def laid_on(head: FaceModel, other: FaceModel) -> np.ndarray:
    """(n, 3) metres in the head's frame: its vertices on the other's mean face, both sides
    alike.
    """
    vertices = other.vertices.astype(np.float64)
    fit = register(head, vertices, other.triangles[other.triangle_part != OTHER])
    target = Surface(
        fit.similarity.inverse().apply(vertices), other.triangles[other.triangle_part == SKIN]
    )
    opposite = mirrored(head.vertices.astype(np.float64))

    def even(points: np.ndarray) -> np.ndarray:
        return 0.5 * (points + points[opposite] * [-1, 1, 1])

    shape = even(fit.shape)
    skin = np.setdiff1d(head.regions["face"], head.regions["lips"])
    for reach, cosine in SCHEDULE:
        normals = vertex_normals(shape, head.triangles)
        used = skin
        for side in SIDES:
            eye = shape[head.regions[f"eye_{side}"]].mean(axis=0)
            used = used[np.linalg.norm(shape[used] - eye, axis=1) > EYE * MM]
        used = used[_thinned(shape[used], reach * SPACING * MM)]
        at = target.nearest(shape[used], normals[used], cosine)
        held = ~at.boundary & (at.distance < NEAR * MM)
        way = at.point[held] - shape[used[held]]
        across = np.einsum("mc,mc->m", way, at.normal[held])[:, None] * at.normal[held]
        way = across + SLIDING * (way - across)
        noise = np.full(len(way), NOISE)
        shape = even(shape + smooth_displacement(shape[used[held]], way, noise, shape, reach * MM))
        print(f"reach {reach} mm: median {np.median(at.distance[held]) / MM:.3f} mm away")
    return shape


def _thinned(points: np.ndarray, spacing: float) -> np.ndarray:
    """(m,) bool, points of which none is nearer to another than ``spacing``."""
    tree = cKDTree(points)
    kept = np.ones(len(points), bool)
    for number, point in enumerate(points):
        if kept[number]:
            near = np.array(tree.query_ball_point(point, spacing))
            kept[near[near > number]] = False
    return kept


def moves(head: FaceModel, other: FaceModel) -> np.ndarray:
    """(n, 3) mm: what is added to the head's neutral face."""
    mesh = assemble()
    masks = Masks(mesh)
    neutral = head.vertices.astype(np.float64)
    narrow = head.regions["narrow_face"]
    shape = laid_on(head, other)
    way = (procrustes(shape[narrow], neutral[narrow]).apply(shape) - neutral) / MM
    # Outlines, whose breadths are published ones, hair and neck stay.
    x, y, z = masks.points.T
    share = smoothstep((64 - np.abs(x)) / 18) * smoothstep((y + 128) / 16)
    share *= smoothstep((60 - y) / 22) * smoothstep((z - 35) / 20)
    result = share[:, None] * way
    for side in SIDES:
        loops = mesh.loops[f"eye_{side}"]
        margin = eyes.MARGIN
        away, _ = cKDTree(masks.points[loops[margin]]).query(masks.points)
        follow = 1 - smoothstep((away - LIDS) / (SOCKET - LIDS))
        follow[loops[margin:]] = 1.0
        follow[mesh.eyeballs[side]] = 1.0
        eye = way[mesh.eyeballs[side]].mean(axis=0)
        result += follow[:, None] * (eye - result)
    _shut(mesh, neutral / MM, result)
    return result


def _shut(mesh: HeadMesh, neutral: np.ndarray, moved: np.ndarray) -> None:
    """Change the moves (n, 3) in mm around the mouth so that lips still meet and are as high as
    published, as nothing on the other model says where their red ends, and what lies behind them
    moves with them as one.
    """
    loops = mesh.loops["mouth"]
    moved[loops] = _of_published_height(neutral[loops], moved[loops])
    meeting = loops[mouth.LIP_LOOPS]
    count = len(meeting)
    number = np.arange(count)  # from a corner along the lower lip, and back along the upper one
    other_lip = meeting[-number]
    met = 0.5 * (moved[meeting] + moved[other_lip])
    moved[loops[mouth.LIP_LOOPS :]] = met
    moved[meeting] += 0.5 * (neutral[other_lip] - neutral[meeting])
    from_corner = np.minimum(number % (count // 2), -number % (count // 2))
    lap = LAP * (1 - smoothstep((from_corner - 6) / 4)) - DIGIT
    lap[from_corner == 0] = 0.0
    moved[meeting, 1] += np.where(number < count // 2, lap, -lap)
    behind = met.mean(axis=0) * [0, 1, 1]
    for index in (mesh.bag, *mesh.teeth.values(), mesh.tongue):
        moved[index] = behind


def _of_published_height(loops: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Moves (rings, n, 3) in mm of the loops around the mouth (rings, n, 3) by which the red of the
    upper lip is as high as it was and that of the lower lip ``LOWER_RED`` in the middle; its
    vertices slide over the same surface.
    """
    rings = mouth.LIP_LOOPS + 1
    red = len(mouth.OUTER_LOOPS) + 1
    share = np.clip((np.arange(rings) - 1) / (red - 1), 0.0, 1.0)
    count = loops.shape[1]
    there = (loops + moved)[:rings]
    met = 0.5 * (moved[rings - 1] + moved[rings - 1, -np.arange(count)])
    middle = loops[rings - 1, count // 4, 1] - loops[red, count // 4, 1]
    result = moved.copy()
    for column in range(count):
        height = there[:, column, 1]
        rises = int(np.sign(height[-1] - height[0]))
        if (rises * np.diff(height) <= 0).any():
            continue  # beside the corners
        scale = LOWER_RED / middle if column < count // 2 else 1.0
        line = loops[rings - 1, column, 1]
        plain = line + met[column, 1] + scale * (loops[:rings, column, 1] - line)
        wanted = height + share * (plain - height)
        for axis in range(3):
            slid = np.interp(wanted, height[::rises], there[::rises, column, axis])
            result[:rings, column, axis] = slid - loops[:rings, column, axis]
    return result


def main() -> None:
    """Write the moves."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", help="ict:PATH")
    found = moves(without_form(build_default_model()), load_model(parser.parse_args().model))
    vertex = np.flatnonzero(np.linalg.norm(found, axis=1) > SMALLEST).astype(np.int32)
    write_arrays(DATA, {"vertex": vertex, "move": found[vertex].astype(np.float32).round(3)})
    print(
        f"{len(vertex)} vertices, by {np.linalg.norm(found[vertex], axis=1).max():.1f} mm at most"
    )


if __name__ == "__main__":
    main()
