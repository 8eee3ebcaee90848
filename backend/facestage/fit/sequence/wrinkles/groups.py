"""Which sliders may bring wrinkles, where on the skin, and which frames of a film tell of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arkit import spellings
from facestage.contract.arrays import Float, Int
from facestage.fit.face.geometry import FaceGeometry

# By ARKit's names. A group's strength is the mean of its sliders.
GROUPS = {
    "smile_left": ("mouthSmileLeft",),
    "smile_right": ("mouthSmileRight",),
    "squint_left": ("eyeSquintLeft", "cheekSquintLeft"),
    "squint_right": ("eyeSquintRight", "cheekSquintRight"),
    "raise": ("browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    "frown": ("browDownLeft", "browDownRight"),
    "sneer": ("noseSneerLeft", "noseSneerRight"),
}
# Skin folds where it moves at least so far, of the most that its sliders move any of it, and next
# to that (metres).
MOVED, BESIDE = 0.15, 0.008
# How far a group's strength must go, between its weakest and its strongest frames, to be asked for.
RANGE_MIN, WEAK, STRONG = 0.2, 10.0, 90.0
FRAMES_MAX = 32  # that are looked at


@dataclass(frozen=True, eq=False)
class Group:
    """Sliders that bring wrinkles together."""

    name: str
    sliders: tuple[str, ...]  # the model's
    strength: Float[np.ndarray, " frames"]  # their mean
    place: Float[np.ndarray, " vertices"]  # 0..1, where on the rendered mesh


def groups_of(
    geometry: FaceGeometry,
    expression: Float[np.ndarray, "frames expressions"],
    seen: Int[np.ndarray, " seen"],
) -> list[Group]:
    """Those that move enough in the frames that were ``seen``."""
    names, result = geometry.model.expression_names, []
    for name, wanted in GROUPS.items():
        sliders = tuple(slider for each in wanted for slider in _of(each, names))
        if not sliders or not len(seen):
            continue
        columns = [names.index(slider) for slider in sliders]
        strength = expression[:, columns].mean(axis=1)
        weak, strong = np.percentile(strength[seen], (WEAK, STRONG))
        if strong - weak >= RANGE_MIN:
            result.append(Group(name, sliders, strength, _place(geometry, columns)))
    return result


def _of(name: str, sliders: Sequence[str]) -> tuple[str, ...]:
    """What a model with these ``sliders`` has for one of ARKit's names."""
    for together in spellings(name):
        found = tuple(slider for slider in together if slider in sliders)
        if found:
            return found
    return ()


def _place(geometry: FaceGeometry, columns: Sequence[int]) -> Float[np.ndarray, " vertices"]:
    """Where skin is that the sliders move."""
    basis = geometry.model.expression_basis[list(columns)][:, geometry.used]
    moved = np.linalg.norm(basis, axis=2).max(axis=0)
    share = np.clip(moved / max(MOVED * float(moved.max()), 1e-12), 0.0, 1.0)
    result = np.zeros(len(share))
    inside = geometry.fitted_vertices
    tree = cKDTree(geometry.mean[inside])
    for vertex, near in zip(inside, tree.query_ball_point(tree.data, BESIDE), strict=True):
        result[vertex] = share[inside[near]].max()
    return result


def telling_frames(
    groups: Sequence[Group], seen: Int[np.ndarray, " seen"], most: int = FRAMES_MAX
) -> Int[np.ndarray, " chosen"]:
    """At most so many of the frames that were ``seen``: of each group strong and weak ones, spread
    over the film.
    """
    if len(seen) <= most:
        return seen
    each = max(most // (2 * max(len(groups), 1)), 1)
    chosen: set[int] = set()
    for group in groups:
        strength = group.strength[seen]
        middle = 0.5 * float(np.sum(np.percentile(strength, (WEAK, STRONG))))
        low, high = np.percentile(strength, (50 - WEAK, STRONG - 15))
        for those in (seen[strength >= max(high, middle)], seen[strength <= min(low, middle)]):
            if len(those):
                place = np.linspace(0, len(those) - 1, min(each, len(those))).round().astype(int)
                chosen |= set(those[place].tolist())
    return np.array(sorted(chosen), int)
