"""The wrinkles of a film: asked of the frames that tell most, and found, or left out and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from facestage.contract.arrays import Float, Float32, Int
from facestage.contract.landmarks import Landmarks
from facestage.contract.wrinkles import Wrinkles
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.surface_frame import FrameField
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.skin.changes import Look
from facestage.fit.sequence.wrinkles.alignment import aligned
from facestage.fit.sequence.wrinkles.folds import Folds, folds_of
from facestage.fit.sequence.wrinkles.groups import Group, groups_of, telling_frames
from facestage.fit.sequence.wrinkles.sheets import Lattice, Sheet, sheet_of
from facestage.fit.sequence.wrinkles.solving import Moments, solved
from facestage.fit.textures.relief_maps.relief import normal_map

SIZE = 512  # texels along the texture
FACE_MIN = 250.0  # pixels along the face, of fewer of which folds are not asked
# Places of a group where folds are believed, and the share of the frames that must see them.
PLACE_MIN, SEEN_ENOUGH = 0.3, 0.5


@dataclass(frozen=True, eq=False)
class GroupWrinkles:
    """The wrinkles of one group of sliders at full strength, over the texture."""

    wrinkles: Wrinkles
    height: Float32[np.ndarray, "size size"]  # mm
    normal: Float32[np.ndarray, "size size 3"]  # tangent space, 0 to 1


@dataclass(frozen=True, eq=False)
class FilmWrinkles:
    """What was found; ``words`` for people."""

    found: tuple[GroupWrinkles, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)
    words: str = ""
    texel_mm: float = 1.0


@dataclass(frozen=True, eq=False)
class Asked:
    """Which groups are asked for, of which frames; ``words``: why none is."""

    groups: list[Group]
    frames: Int[np.ndarray, " chosen"]
    words: str = ""

    @classmethod
    def of(
        cls,
        geometry: FaceGeometry,
        expression: Float[np.ndarray, "frames expressions"],
        landmarks: Sequence[Landmarks | None],
    ) -> Asked:
        """Of a film with these courses; ``landmarks`` None: the face was not seen."""
        seen = np.array([place for place, own in enumerate(landmarks) if own is not None], int)
        sizes = [face_size_px(own) for own in landmarks if own is not None]
        size, none = float(np.median(sizes)) if sizes else 0.0, np.zeros(0, int)
        if size < FACE_MIN:
            words = f"the face is {size:.0f} pixels long, wrinkles need {FACE_MIN:.0f}"
            return cls([], none, words)
        groups = groups_of(geometry, expression, seen)
        if not groups:
            return cls([], none, "no expression that brings any moves far enough")
        return cls(groups, telling_frames(groups, seen))


def film_wrinkles(actor: Actor, asked: Asked, looks: Iterable[Look]) -> FilmWrinkles:
    """What ``looks`` at the frames that are ``asked`` show."""
    if not asked.groups:
        return FilmWrinkles(words=f"wrinkles were not looked for ({asked.words})")
    lattice = Lattice.of(actor.geometry, SIZE)
    sheets, frames = list[Sheet](), list[int]()
    for look in looks:
        sheets.append(sheet_of(lattice, actor, look.cut, look.state))
        frames.append(look.index)
    folds = folds_in(lattice, asked.groups, frames, sheets)
    found, figures = list[GroupWrinkles](), dict[str, float]()
    rest = FrameField.of(actor.geometry, actor.geometry.mean)
    every = rest.at(lattice.atlas.triangle, lattice.atlas.weights.astype(np.float64))
    for group, own in zip(asked.groups, folds, strict=True):
        figures[f"wrinkles_{group.name}_mm"] = own.depth
        figures[f"wrinkles_{group.name}_noise_mm"] = own.noise
        if own.are_clear:
            height = lattice.texture(own.height)
            normal = normal_map(lattice.atlas, every, height)
            found.append(GroupWrinkles(Wrinkles(group.name, group.sliders), height, normal))
    words = _words(asked.groups, [each.wrinkles.name for each in found])
    return FilmWrinkles(tuple(found), figures, words, lattice.spacing)


def folds_in(
    lattice: Lattice, groups: Sequence[Group], frames: Sequence[int], sheets: Sequence[Sheet]
) -> list[Folds]:
    """The valleys that come with each group, by the ``sheets`` of these ``frames``."""
    strength = np.array([group.strength[list(frames)] for group in groups])
    places = np.array([lattice.baked(group.place) for group in groups])
    laid = aligned(sheets, strength, lattice.spacing)
    fields = solved(Moments.of(laid, strength), places, lattice.spacing)
    seen = np.mean([sheet.weight > 1 for sheet in laid], axis=0) > SEEN_ENOUGH
    return [
        folds_of(height, seen & (place > PLACE_MIN), lattice.spacing)
        for height, place in zip(fields.height, places, strict=True)
    ]


def _words(groups: Sequence[Group], found: Sequence[str]) -> str:
    left_out = [group.name for group in groups if group.name not in found]
    parts = []
    if found:
        parts.append(f"wrinkles come with {' and '.join(found)}")
    if left_out:
        lead = "those with" if found else "wrinkles with"
        parts.append(f"{lead} {' and '.join(left_out)} are not clearly seen, and were left out")
    return "; ".join(parts)
