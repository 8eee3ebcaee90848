"""What a fit of several photos needs to go on: each photo's checkpoint, and who shares the shape."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.storage import read_arrays, write_arrays
from facestage.fit.checkpoint import Checkpoint, damaged

FILE = "person-checkpoint.npz"


@dataclass(frozen=True)
class JointCheckpoint:
    """After a step of all photos. Phase, step and damping are the same in every photo's."""

    photos: tuple[Checkpoint, ...]
    doubts: tuple[str, ...]  # per photo: why it left the shared shape, or empty
    joined: tuple[bool, ...]  # per photo: whether it takes part in the joint fit
    shape_held: bool  # no photo was believed: the shape is the landmarks'

    def save(self, folder: Path) -> None:
        """Write the checkpoint into ``folder``, replacing the previous one."""
        meta = {"doubts": self.doubts, "joined": self.joined, "shape_held": self.shape_held}
        arrays = {"meta": np.array(json.dumps(meta))}
        for number, photo in enumerate(self.photos):
            arrays |= {f"{number}/{name}": array for name, array in photo.arrays().items()}
        write_arrays(folder / FILE, arrays, compress=False)

    @classmethod
    def load(cls, folder: Path) -> JointCheckpoint | None:
        """The checkpoint in ``folder``, or None when there is none. Raises InputError when it is damaged."""
        if not (folder / FILE).is_file():
            return None
        arrays = read_arrays(folder / FILE, "checkpoint")
        try:
            meta = json.loads(str(arrays["meta"]))
            doubts, joined = tuple(map(str, meta["doubts"])), tuple(map(bool, meta["joined"]))
            held = bool(meta["shape_held"])
        except (KeyError, ValueError, TypeError) as error:
            raise damaged(folder, error) from error
        photos = []
        for number in range(len(doubts)):
            prefix = f"{number}/"
            own = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
            photos.append(Checkpoint.from_arrays(own, folder))
        return cls(tuple(photos), doubts, joined, held)
