"""Landmarks of a face in pixels, and their file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_json
from facestage.contract.schemas.array_field import FLAGS, Array
from facestage.contract.schemas.fields import Choice
from facestage.contract.schemas.schema import FileSchema, checked

# A profile is a third as wide as it is high; landmarks narrower than this share are no face.
LINE_SHARE = 0.04
IBUG, MEDIAPIPE = "ibug68", "mediapipe478"
SCHEME_SIZES = {IBUG: 68, MEDIAPIPE: 478}
PIXEL_MAX = 1e7  # a point further off is no place on any photo
WEIGHT_MAX = 1e6


class SchemeSchema(FileSchema):
    """Which points a landmarks.json holds."""

    scheme = Choice(tuple(SCHEME_SIZES))


class LandmarkSchema(FileSchema):
    """The points themselves; where nothing is known of a hidden one, null stands for its place."""

    points = Array(
        ("points", 2),
        minimum=-PIXEL_MAX,
        maximum=PIXEL_MAX,
        finite=False,
        nulls=True,
        words="[x, y] in pixels for each point",
    )
    visible = Array(("points",), FLAGS, words="true or false for each point", load_default=None)
    weights = Array(
        ("points",),
        minimum=0,
        maximum=WEIGHT_MAX,
        words="a number of 0 or more for each point",
        load_default=None,
    )


@dataclass(frozen=True)
class Landmarks:
    """Points in pixels of a named scheme, with a visibility flag each.

    ``weights`` >= 0 say how much each point counts beside what its scheme says of it: 1 is as
    usual, 0 not at all, 4 as a point of half the standard deviation; None is 1 for all.
    """

    scheme: str
    points: Float[np.ndarray, "landmarks 2"]
    visible: Bool[np.ndarray, " landmarks"]
    weights: Float[np.ndarray, " landmarks"] | None = None

    @property
    def counted(self) -> Bool[np.ndarray, " landmarks"]:
        """The visible points that are not left out by a weight of 0."""
        return self.visible if self.weights is None else self.visible & (self.weights > 0)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], what: str = "landmarks") -> Landmarks:
        """The landmarks of a decoded landmarks.json.

        Raises InputError for a wrong count or value.
        """
        subject = f"The {what}"
        scheme = checked(SchemeSchema(), data, subject)["scheme"]
        count = SCHEME_SIZES[scheme]
        found = checked(LandmarkSchema(points=count), data, subject)
        points, visible = found["points"].astype(np.float64), found["visible"]
        result = cls(
            scheme, points, np.ones(count, bool) if visible is None else visible, found["weights"]
        )
        if not np.isfinite(points[result.counted]).all():
            raise InputError(
                f"The {what} holds NaN or infinity for a visible point; remove it or mark it "
                "hidden."
            )
        if result.counted.sum() < 6:
            raise InputError(
                f"The {what} marks {result.counted.sum()} points visible; at least 6 are "
                "needed to place a face."
            )
        return result

    @classmethod
    def read(cls, path: Path) -> Landmarks:
        """The landmarks in a landmarks.json file."""
        return cls.from_json(read_json(path, "landmark file"), f"landmark file '{path}'")

    def to_json(self) -> dict[str, Any]:
        """The landmarks as landmarks.json holds them."""
        result = {
            "scheme": self.scheme,
            "points": self.points.tolist(),
            "visible": self.visible.tolist(),
        }
        return result if self.weights is None else result | {"weights": self.weights.tolist()}

    def check_inside(self, width: int, height: int) -> None:
        """Raise InputError when the visible points do not lie on a ``width`` x ``height`` image.

        Half an image of slack: detectors extrapolate a face that the frame cuts.
        """
        points = self.points[self.counted]
        inside = (points > [-0.5 * width, -0.5 * height]).all(1) & (
            points < [1.5 * width, 1.5 * height]
        ).all(1)
        centre = np.median(points, axis=0)
        if not inside.all() or not (0 <= centre[0] <= width and 0 <= centre[1] <= height):
            raise InputError(
                f"{int((~inside).sum())} landmarks lie far outside the {width} x {height} photo "
                f"(median at {centre[0]:.0f}, {centre[1]:.0f}); were they made for this photo and "
                "at this size?"
            )
        if np.ptp(points, axis=0).max() < 4.0:
            raise InputError(
                "The landmarks span less than 4 pixels; a face that small cannot be fitted, "
                "use a larger photo."
            )
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] < LINE_SHARE * spread[0]:
            raise InputError(
                "The landmarks lie on one line, as those of no face do; check that the file "
                "has both coordinates right."
            )
