"""Errors of a sequence against a file that knows better: it changes nothing, it adds numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.reading import GIB
from facestage.contract.files.storage import read_arrays
from facestage.contract.light_stage import FAR
from facestage.contract.parameters import WEIGHT_MAX
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.schema import FileSchema, checked
from facestage.fit.given.metrics import aligned_distance
from facestage.fit.sequence.course import Course

ARRAYS_MAX = 4 * GIB
# A weight that moves less than this says nothing of how well it was followed.
MOVING = 0.05
LAG_MAX = 6  # frames
# A head is nearer than this many metres; what is further away is given in millimetres.
METRES_MAX = 50.0


class SequenceTruthSchema(FileSchema):
    """A truth of a sequence; names and weights of expressions may be missing."""

    dimensions: ClassVar = {}

    vertices = Array(("frames", "vertices", 3), minimum=-FAR, maximum=FAR)
    expression = Array(
        ("frames", "expressions"), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX, required=False
    )


class SequenceTruth:
    """Known vertices (F, n, 3) of the model or of its narrow face, in the camera frame and metres;
    or, as OpenCV has it, in millimetres, y down and z away from the camera.
    """

    def __init__(self, path: Path, model: FaceModel, frames: int) -> None:
        """Raises InputError for what is not this model's, or another film's."""
        arrays = read_arrays(path, "truth file", ARRAYS_MAX)
        names = arrays.pop("names", None)
        known = {name: arrays[name] for name in SequenceTruthSchema().fields if name in arrays}
        found: dict[str, Any] = checked(SequenceTruthSchema(), known, f"The truth file '{path}'")
        vertices = found["vertices"].astype(np.float64)
        narrow = model.regions.get("narrow_face", np.arange(len(model.vertices)))
        if vertices.shape[1] == len(model.vertices):
            vertices = vertices[:, narrow]
        if vertices.shape[:2] != (frames, len(narrow)):
            raise InputError(
                f"The truth file '{path}' has {vertices.shape[0]} frames of {vertices.shape[1]} "
                f"vertices; expected {frames} of {len(model.vertices)}, or of the {len(narrow)} of "
                "the narrow face."
            )
        if np.median(vertices[..., 2]) > 0:
            vertices = vertices * [1.0, -1.0, -1.0]
        if np.median(np.abs(vertices[..., 2])) > METRES_MAX:
            vertices = vertices * 1e-3
        self.region, self.vertices = narrow, vertices
        self.expression = found.get("expression")
        self.names = () if names is None else tuple(map(str, np.ravel(names)))

    def errors(self, model: FaceModel, course: Course) -> dict[str, float]:
        """Over the narrow face, ``model`` being the person's own: mean distances in mm after one
        similarity for all frames, and after one for each; jitter over the truth's; frames that the
        motion comes too late; of each expression that moves, its correlation with the truth.
        """
        found = self._found(model, course)
        flat, true = found.reshape(-1, 3), self.vertices.reshape(-1, 3)
        each = [
            aligned_distance(*pair, scale=True) for pair in zip(found, self.vertices, strict=True)
        ]
        one = 1e3 * aligned_distance(flat, true, scale=True).reshape(found.shape[:2]).mean(axis=1)
        errors = {
            "similarity_mm": float(one.mean()),
            "worst_frame_mm": float(one.max()),
            "frame_similarity_mm": 1e3 * float(np.mean(each)),
        }
        if len(found) > 2:
            errors["jitter_ratio"] = jitter(found) / max(jitter(self.vertices), 1e-12)
        return errors | self._of_weights(model, course)

    def _found(self, model: FaceModel, course: Course) -> Float[np.ndarray, "frames vertices 3"]:
        basis = model.expression_basis[:, self.region].astype(np.float64)
        shape = model.vertices[self.region] + np.tensordot(course.expression, basis, 1)
        turned = np.einsum("fij,fnj->fni", course.rotation, shape)
        return np.asarray(turned + course.translation[:, None])

    def _of_weights(self, model: FaceModel, course: Course) -> dict[str, float]:
        if self.expression is None or len(self.names) != self.expression.shape[1]:
            return {}
        errors, pairs = {}, []
        for index, name in enumerate(model.expression_names):
            if name not in self.names:
                continue
            true, found = self.expression[:, self.names.index(name)], course.expression[:, index]
            if true.std() > MOVING:
                pairs.append((found, true))
                still = found.std() < 1e-9
                errors[f"correlation_{name}"] = (
                    0.0 if still else float(np.corrcoef(found, true)[0, 1])
                )
        if pairs and len(course) > 2 * LAG_MAX:
            errors["lag_frames"] = float(lag(pairs))
        return errors


def jitter(vertices: Float[np.ndarray, "frames vertices 3"]) -> float:
    """Root mean square length of the second differences in time."""
    return float(np.sqrt((np.diff(vertices, 2, axis=0) ** 2).sum(axis=2).mean()))


def lag(pairs: list[tuple[np.ndarray, np.ndarray]]) -> int:
    """By how many frames the first curves of ``pairs`` come later than the second: where their
    cross-correlation is highest.
    """

    def correlation(shift: int) -> float:
        total = 0.0
        for found, true in pairs:
            a = found[LAG_MAX + shift : len(found) - LAG_MAX + shift]
            b = true[LAG_MAX : len(true) - LAG_MAX]
            scale = max(float(a.std() * b.std()), 1e-12)
            total += float(((a - a.mean()) * (b - b.mean())).mean()) / scale
        return total

    return max(range(-LAG_MAX, LAG_MAX + 1), key=correlation)
