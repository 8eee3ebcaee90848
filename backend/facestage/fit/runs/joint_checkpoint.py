"""What a fit of several photos needs to go on: each photo's checkpoint, and who shares the
shape.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from facestage.contract.files.partial import PERSON_CHECKPOINT
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.schemas.schema import decoded_meta
from facestage.fit.runs.checkpoint import AGAIN, SCHEMA_VERSION, Checkpoint, damaged, other_version
from facestage.fit.runs.checkpoint_schema import finite
from facestage.fit.runs.member import Member
from facestage.fit.stages.joint_descent import JointIteration
from facestage.fit.stages.passage import Passage


@dataclass(frozen=True)
class JointCheckpoint:
    """Where a phase of all photos began, and how far it was.

    Phase, step and damping are the same in every photo's.
    """

    photos: tuple[Checkpoint, ...]
    doubts: tuple[str, ...]  # per photo: why it left the shared shape, or empty
    # per photo: how far the fit had pulled its shape when it was last asked
    statistics: tuple[float, ...]
    joined: tuple[bool, ...]  # per photo: whether it takes part in the joint fit
    shape_held: bool  # no photo was believed: the shape is the landmarks'

    @property
    def phase(self) -> str:
        """The name of the phase."""
        return self.photos[0].phase

    @classmethod
    def of(
        cls, members: list[Member], phase: str, seconds: float, shape_held: bool
    ) -> JointCheckpoint:
        """Before anything of the phase is done."""
        return cls(
            tuple(
                Checkpoint.of(one.view, phase, seconds, None, one.state, one.trace)
                for one in members
            ),
            tuple(one.doubt for one in members),
            tuple(float(one.statistic) for one in members),
            tuple(one.joined for one in members),
            shape_held,
        )

    def with_relief(self, count: int) -> JointCheckpoint:
        """With flat relief of ``count`` fields where it was written by a version that knew none."""
        return replace(self, photos=tuple(photo.with_relief(count) for photo in self.photos))

    def after(
        self, item: JointIteration, company: Sequence[tuple[Member, Passage]], seconds: float
    ) -> JointCheckpoint:
        """The same phase after a step of those who go through it together."""
        photos = list(self.photos)
        for (member, passage), part in zip(company, item.parts, strict=True):
            index = member.number - 1
            photos[index] = photos[index].after(
                passage.within(part), member.view, seconds, member.trace
            )
        return replace(self, photos=tuple(photos))

    def save(self, folder: Path) -> None:
        """Write the checkpoint into ``folder``, replacing the previous one."""
        meta = {
            "schema": SCHEMA_VERSION,
            "doubts": self.doubts,
            "statistics": self.statistics,
            "joined": self.joined,
            "shape_held": self.shape_held,
        }
        arrays = {"meta": np.array(json.dumps(meta))}
        for number, photo in enumerate(self.photos):
            arrays |= {f"{number}/{name}": array for name, array in photo.arrays().items()}
        write_arrays(folder / PERSON_CHECKPOINT, arrays, compress=False)

    @classmethod
    def load(cls, folder: Path) -> JointCheckpoint | None:
        """The checkpoint in ``folder``, or None when there is none.

        Raises InputError when it is damaged.
        """
        if not (folder / PERSON_CHECKPOINT).is_file():
            return None
        arrays = read_arrays(folder / PERSON_CHECKPOINT, "checkpoint")
        meta = decoded_meta(str(arrays.get("meta")), f"The checkpoint in '{folder}'", AGAIN)
        if meta.get("schema") != SCHEMA_VERSION:
            raise other_version(folder)
        try:
            doubts, joined = tuple(map(str, meta["doubts"])), tuple(map(bool, meta["joined"]))
            statistics, held = tuple(map(finite, meta["statistics"])), bool(meta["shape_held"])
            if not len(doubts) == len(joined) == len(statistics) > 1:
                raise ValueError("lists of different lengths")
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            raise damaged(folder, error) from error
        photos = []
        for number in range(len(doubts)):
            prefix = f"{number}/"
            own = {
                name.removeprefix(prefix): array
                for name, array in arrays.items()
                if name.startswith(prefix)
            }
            photos.append(Checkpoint.from_arrays(own, folder))
        return cls(tuple(photos), doubts, statistics, joined, held)
