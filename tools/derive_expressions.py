"""How far the built-in head's skin goes in each expression: its table of pulls.

python tools/derive_expressions.py ict:PATH [NAME ...]

Warps the built-in head onto the mean face of ICT-FaceKit by the landmarks that both have, takes
from there how its expressions of the same name move the skin, and finds the Gaussian pulls
(models/head/expression_table.py) that say so best, each begun where the table has it; a new pull is
written there with a move of zero first. The lips count as much as the rest of the face, and one
side as much as both together. Prints for each expression how much of the motion the table leaves,
before and after, and the pulls that leave least. The table holds them, but for the lips of puffed
cheeks, which would part; nobody else needs to run this.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from facestage.contract.face_model import FaceModel
from facestage.models.head import mouth
from facestage.models.head.assemble import HeadMesh, assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.expression_table import BOTH, ONE_SIDED, Fold, Muscle
from facestage.models.head.expressions import pulled
from facestage.models.head.masks import Masks
from facestage.models.mesh.similarity import procrustes
from facestage.models.registry import load_model

MM = 1e-3
SCHEME = "mediapipe478"
JAW = 15.0  # mm by which what the jaw carries lies apart from what it does not, so that lips part
RADII = 5.0, 30.0  # mm, of a pull
DRIFT = 12.0  # mm that a pull's centre may move from where it was
SPARE = 0.005  # share of the motion's energy for which a pull may be as large as the largest motion
LIPS = 0.5  # how much lips and skin beside them count of the whole; by its area a tenth
BESIDE = 6.0  # mm from the lips over which that falls off
TOUCHING, AROUND = 2.0, 4.0  # mm of lip before the teeth, all of those around it


def places(model: FaceModel) -> np.ndarray:
    """(478, 3) landmarks in mm."""
    table = model.landmarks[SCHEME]
    corners = model.vertices[table[:, :3].astype(int)].astype(np.float64) / MM
    return np.einsum("pk,pkc->pc", table[:, 3:], corners)


def motions(head: FaceModel, other: FaceModel, face: np.ndarray) -> dict[str, np.ndarray]:
    """How the other model's expressions of the same names would move the head's face, (m, 3) mm."""
    here, there = places(head), places(other)
    onto = procrustes(there, here)
    skin = other.regions["narrow_face"]
    points = other.vertices[skin].astype(np.float64) / MM
    opened = _jaw(other)[skin]
    mine = _jaw(head)[face]
    warp = RBFInterpolator(here, there, smoothing=1.0, neighbors=60)
    warped = warp(head.vertices[face].astype(np.float64) / MM)
    tree = cKDTree(np.column_stack([points, JAW * opened]))
    distance, near = tree.query(np.column_stack([warped, JAW * mine]), k=4)
    weight = 1.0 / np.maximum(distance, 0.1) ** 2
    weight /= weight.sum(axis=1, keepdims=True)
    result = {}
    for name in head.expression_names:
        moved = _motion(other, name)
        if moved is not None:
            moved = onto.scale * moved[skin] @ onto.rotation.T
            result[name] = np.einsum("mk,mkc->mc", weight, moved[near])
    return result


def _jaw(model: FaceModel) -> np.ndarray:
    """(n,) 0 to 1: how far each vertex follows the jaw."""
    moved = _motion(model, "jawOpen")
    if moved is None:
        raise SystemExit(f"'{model.name}' has no expression jawOpen; give a model with ARKit's.")
    distance = np.linalg.norm(moved, axis=1)
    return distance / distance.max()


def _motion(model: FaceModel, name: str) -> np.ndarray | None:
    """(n, 3) mm; a name that the model has for each side apart is the sum of both."""
    names = list(model.expression_names)
    sided = name.replace("Left", "_L").replace("Right", "_R")
    found = [n for n in (name, sided) if n in names][:1] or [
        n for n in (name + "_L", name + "_R") if n in names
    ]
    if not found:
        return None
    return sum(model.expression_basis[names.index(n)].astype(np.float64) for n in found) / MM


def counted(mesh: HeadMesh, face: np.ndarray) -> np.ndarray:
    """How much each of the face's vertices counts, 1 in all: as the skin around it, and the lips
    by ``LIPS``.
    """
    points = mesh.vertices[face]
    # Lips have thousands of vertices.
    skin = cKDTree(points).query(points, k=9)[0][:, -1] ** 2
    lips = mesh.vertices[mesh.loops["mouth"][len(mouth.OUTER_LOOPS) : mouth.LIP_LOOPS].ravel()]
    near = skin * np.exp(-((cKDTree(lips).query(points)[0] / BESIDE) ** 2))
    return (1 - LIPS) * skin / skin.sum() + LIPS * near / near.sum()


def before_teeth(mesh: HeadMesh, face: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """The motion (m, 3) of the face's vertices, no further back than ``TOUCHING`` before the teeth
    that they come to lie before.
    """
    teeth = mesh.vertices[np.concatenate([mesh.teeth["upper"], mesh.teeth["lower"]])]
    points = mesh.vertices[face]
    near = cKDTree(teeth[:, :2]).query_ball_point((points + motion)[:, :2], AROUND)
    front = np.array([teeth[k, 2].max() if k else -np.inf for k in near])
    result = motion.copy()
    result[:, 2] = np.maximum(motion[:, 2], np.minimum(front + TOUCHING - points[:, 2], 0.0))
    return result


def refined(
    masks: Masks,
    pulls: tuple[Muscle | Fold, ...],
    targets: dict[str | None, np.ndarray],
    face: np.ndarray,
    count: np.ndarray,
) -> tuple[Muscle | Fold, ...]:
    """The pulls with centres, radii and moves that come nearest to the motions (m, 3) of the face's
    vertices, each counted ``count`` (m,).

    ``targets``: by the side that is pulled, None for both sides together.
    """

    def all_pulled(these: tuple[Muscle | Fold, ...]) -> np.ndarray:
        return np.concatenate([pulled(masks, these, side)[face] for side in targets])

    muscles = [pull for pull in pulls if isinstance(pull, Muscle)]
    folds = tuple(pull for pull in pulls if isinstance(pull, Fold))
    rest = np.concatenate(list(targets.values())) - all_pulled(folds)
    count = np.tile(count, len(targets))
    start = np.array([[*m.center, *m.radii] for m in muscles], np.float64)
    middle = start[:, 0] == 0  # such a pull stays on the midline
    low = np.column_stack([start[:, :2] - DRIFT, np.full((len(start), 2), RADII[0])])
    high = np.column_stack([start[:, :2] + DRIFT, np.full((len(start), 2), RADII[1])])
    low[:, 0] = np.where(middle, -1e-6, np.maximum(low[:, 0], 2.0))
    high[middle, 0] = 1e-6
    root = np.sqrt(count)[:, None]
    spare = np.sqrt(SPARE * (count[:, None] * rest**2).sum()) / np.abs(rest).max()

    def moves(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Moves (k, 3) that are best for these centres and radii, and what is left over."""
        shapes = []
        for muscle, (x, y, rx, ry) in zip(muscles, values.reshape(-1, 4), strict=True):
            one = replace(muscle, center=(x, y), radii=(rx, ry), move=(1.0, 1.0, 1.0))
            shapes.append(all_pulled((one,)))
        design = np.stack(shapes, axis=-1) * root[..., None]  # (m, 3, k)
        found, left = [], []
        for axis in range(3):
            a = np.concatenate([design[:, axis], spare * np.eye(len(muscles))])
            b = np.concatenate([root[:, 0] * rest[:, axis], np.zeros(len(muscles))])
            found.append(np.linalg.lstsq(a, b, rcond=None)[0])
            left.append(a @ found[-1] - b)
        return np.stack(found, axis=-1), np.concatenate(left)

    start = np.clip(start, low + 1e-9, high - 1e-9)
    best = least_squares(
        lambda values: moves(values)[1], start.ravel(), bounds=(low.ravel(), high.ravel()),
        x_scale=5.0, max_nfev=60, diff_step=1e-3,
    )  # fmt: skip
    found = moves(best.x)[0]
    result = [
        replace(
            muscle,
            center=(0 if muscle.center[0] == 0 else round(x), round(y)),
            radii=(round(rx), round(ry)),
            move=(round(float(dx), 1), round(float(dy), 1), round(float(dz), 1)),
        )
        for muscle, (x, y, rx, ry), (dx, dy, dz) in zip(
            muscles, best.x.reshape(-1, 4), found, strict=True
        )
    ]
    return (*result, *folds)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", help="a model with expressions of ARKit's names: ict:PATH")
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these (mouthSmile, ...)")
    arguments = parser.parse_args()
    head, other = build_default_model(), load_model(arguments.model)
    mesh = assemble()
    masks = Masks(mesh)
    face = np.intersect1d(head.regions["narrow_face"], np.flatnonzero(masks.front > 0.5))
    wanted = motions(head, other, face)
    count = counted(mesh, face)
    for table, side in ((ONE_SIDED, "left"), (BOTH, None)):
        for stem, pulls in table.items():
            name = stem if side is None else stem + "Left"
            lids = stem.startswith("eye")  # these turn about the eyeball
            if name not in wanted or lids or stem not in (arguments.names or [stem]):
                continue
            # Most smiles are of both sides, whose tails meet on the lips.
            targets = {side: wanted[name]}
            if side is None:
                targets[side] = before_teeth(mesh, face, wanted[name])
            else:
                targets[None] = wanted[name] + wanted[stem + "Right"]
            for title, these in (
                ("now", pulls), ("best", refined(masks, pulls, targets, face, count)),
            ):  # fmt: skip
                print(f"{stem}: {title}")
                for each, target in targets.items():
                    said = pulled(masks, these, each)[face]
                    energy = (count[:, None] * target**2).sum()
                    left = (count[:, None] * (said - target) ** 2).sum() / energy
                    gain = (count[:, None] * said * target).sum() / energy
                    sides = each or "both sides"
                    print(f"    {sides}: leaves {left:.3f} of the motion, goes {gain:.2f} as far")
            for pull in these:
                print(f"        {pull!r},")


if __name__ == "__main__":
    main()
