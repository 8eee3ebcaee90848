"""How far the passes over the pictures are: what a run needs to go on from any frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.partial import SEQUENCE_CHECKPOINT
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.fit.sequence.course import Course
from facestage.fit.sequence.frame_light import LightEquations
from facestage.fit.sequence.landmark_bias import LandmarkBias
from facestage.fit.sequence.motion import Motion, Triples
from facestage.fit.sequence.tracking import Pictures, Tracked


@dataclass(frozen=True, eq=False)
class PassCheckpoint:
    """``done`` frames of pass ``number`` were looked at, at ``tracked``; what ``pictures`` said."""

    number: int
    done: int
    tracked: Tracked
    pictures: Pictures

    def save(self, folder: Path) -> None:
        """Write it, whole or not at all."""
        tracked, pictures = self.tracked, self.pictures
        write_arrays(
            folder / SEQUENCE_CHECKPOINT,
            {
                "number": np.array(self.number),
                "done": np.array(self.done),
                "rotation": tracked.course.rotation,
                "translation": tracked.course.translation,
                "expression": tracked.course.expression,
                "triples": tracked.motion.triples.frames,
                "factors": tracked.motion.triples.factors,
                "groups": tracked.motion.groups,
                "scales": tracked.motion.scales,
                "weights": tracked.motion.weights,
                "offset": tracked.bias.offset,
                "scale": np.array(tracked.bias.scale),
                "deviation": tracked.deviation,
                "landmark_rms": tracked.landmark_rms,
                "photo_rms": tracked.photo_rms,
                "hessian": pictures.hessian,
                "gradient": pictures.gradient,
                "rms": pictures.rms,
                "light_hessian": pictures.light.hessian,
                "light_gradient": pictures.light.gradient,
                "light_cross": pictures.light.cross,
                "light_cost": pictures.light.cost,
                "lights": np.zeros((0, 0)) if tracked.lights is None else tracked.lights,
            },
            compress=False,
        )

    @classmethod
    def load(cls, folder: Path) -> PassCheckpoint | None:
        """The one that an earlier run left, if any. Raises InputError when it is damaged."""
        path = folder / SEQUENCE_CHECKPOINT
        if not path.is_file():
            return None
        found = read_arrays(path, "checkpoint")
        if "light_cost" not in found and "hessian" in found:
            return None  # of a version whose frames had no light of their own: seen once more
        try:
            return cls._of(found)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"The checkpoint '{path}' is damaged ({error}); start again without --resume."
            ) from error

    @classmethod
    def _of(cls, found: Mapping[str, np.ndarray]) -> PassCheckpoint:
        course = Course(found["rotation"], found["translation"], found["expression"])
        triples = Triples(found["triples"], found["factors"])
        motion = Motion(triples, found["groups"], found["scales"], found["weights"])
        bias = LandmarkBias(found["offset"], float(found["scale"]))
        tracked = Tracked(
            course,
            motion,
            bias,
            found["deviation"],
            found["landmark_rms"],
            found["photo_rms"],
            found["lights"] if len(found["lights"]) else None,
        )
        light = LightEquations(
            found["light_hessian"],
            found["light_gradient"],
            found["light_cross"],
            found["light_cost"],
        )
        pictures = Pictures(found["hessian"], found["gradient"], found["rms"], light)
        return cls(int(found["number"]), int(found["done"]), tracked, pictures)
