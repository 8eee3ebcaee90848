"""The default head's expressions: as far as people's go, folds, closed mouths closed."""

from functools import cache

import numpy as np
import pytest

from facestage.contract.arkit import ARKIT_NAMES
from facestage.contract.face_model import FaceModel
from facestage.models.head.assemble import assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.expression_table import BOTH, ONE_SIDED, Fold
from facestage.models.head.expressions import pulled
from facestage.models.head.masks import Masks
from facestage.models.mesh.similarity import procrustes

MM = 1e-3
SCHEME = "mediapipe478"


@cache
def masks() -> Masks:
    return Masks(assemble())


def landmarks(model: FaceModel, values: np.ndarray) -> np.ndarray:
    """(478, 3) mm of values (n, 3) in metres."""
    table = model.landmarks[SCHEME]
    corners = values[table[:, :3].astype(int)].astype(np.float64) / MM
    return np.einsum("pk,pkc->pc", table[:, 3:], corners)


def of_scans(model: FaceModel, name: str) -> np.ndarray | None:
    """(478, 3) mm an expression of ICT-FaceKit by its ARKit name."""
    names = model.expression_names
    sided = [n for n in (name, name.replace("Left", "_L").replace("Right", "_R")) if n in names]
    both = [n for n in (name + "_L", name + "_R") if n in names]
    found = [model.expression_basis[names.index(n)] for n in sided[:1] or both]
    return landmarks(model, np.sum(found, axis=0)) if found else None


def test_expressions_go_where_scanned_people_go(ict_facekit: FaceModel):
    """At the landmarks, by direction and by size. Modelled by hand they correlated by 0.72 on
    average, and went 0.46 as far.
    """
    default = build_default_model()
    onto = procrustes(
        landmarks(ict_facekit, ict_facekit.vertices), landmarks(default, default.vertices)
    )
    table = [n for n in ARKIT_NAMES if n.removesuffix("Left").removesuffix("Right") in pulls()]
    alike, far = {}, {}
    for name in table:
        theirs = of_scans(ict_facekit, name)
        if theirs is None or name.startswith(("eye", "mouthRoll")):
            continue  # lids turn about the eyeball; rolled lips would go through the teeth
        theirs = onto.scale * theirs @ onto.rotation.T
        k = default.expression_names.index(name)
        ours = landmarks(default, default.expression_basis[k])
        alike[name] = (ours * theirs).sum() / np.linalg.norm(ours) / np.linalg.norm(theirs)
        far[name] = (ours * theirs).sum() / (theirs**2).sum()
    print({n: (round(alike[n], 2), round(far[n], 2)) for n in alike})
    assert len(alike) > 24
    assert min(alike.values()) > 0.82 and np.mean(list(alike.values())) > 0.92
    assert min(far.values()) > 0.6 and max(far.values()) < 1.1


def pulls() -> dict[str, tuple]:
    return {**ONE_SIDED, **BOTH}


def test_a_fold_is_a_step_beside_the_mouth():
    fold = Fold(height=2.0)
    step = pulled(masks(), (fold,), "left")
    points = masks().points
    skin = masks().front > 0.99
    outwards = step @ [0.45, 0.0, 0.89]
    middle = np.array(fold.line[2])
    across = np.array([0.85, 0.53])  # at a right angle to the line there, away from the midline
    for side, sign in ((1, 1), (-1, -1)):
        near = np.linalg.norm(points[:, :2] - middle - side * fold.width * across, axis=1) < 4
        assert (near & skin).sum() > 3
        assert sign * outwards[near & skin].mean() > 0.6 * fold.height
    assert np.abs(outwards).max() < 1.05 * fold.height
    ends = [np.linalg.norm(points[:, :2] - np.array(fold.line[k]), axis=1) < 2 for k in (0, -1)]
    assert np.abs(outwards[ends[0] | ends[1]]).max() < 0.25 * fold.height
    far = np.linalg.norm(points[:, :2] - middle, axis=1) > 45
    assert np.abs(step[far]).max() < 0.01 and np.abs(step[points[:, 0] < 0]).max() < 0.01


@pytest.mark.parametrize(
    "name", ["mouthSmile", "cheekPuff", "mouthPucker", "mouthFrown", "browDown"]
)
def test_closed_mouths_stay_closed(name):
    """The lips' inmost loop: what lies above the mouth's line and what lies below it, at full
    strength, no further apart than at rest.
    """
    loop = masks().mesh.loops["mouth"][-1]
    n = len(loop)
    above, below = loop[n // 2 + 1 :][::-1], loop[1 : n // 2]
    m = min(len(above), len(below))
    moved = pulled(masks(), pulls()[name], None)
    apart = np.abs((moved[above[:m]] - moved[below[:m]])[:, 1])
    assert apart.max() < 1.0, f"{name} parts the lips by {apart.max():.1f} mm"
