"""Arrays in files: named ones of an .npz, and nested lists of JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from marshmallow import ValidationError

from facestage.contract.arrays import Num
from facestage.contract.schemas.fields import Checked, range_words
from facestage.contract.wording import shown

NUMBERS, WHOLE, FLAGS = "numbers", "whole numbers", "true or false"
_KINDS = {NUMBERS: "iuf", WHOLE: "iu", FLAGS: "b"}
_PYTHON: Mapping[str, tuple[type, ...]] = {NUMBERS: (int, float), WHOLE: (int,), FLAGS: (bool,)}
_TYPES = {NUMBERS: np.float64, WHOLE: np.int64, FLAGS: np.bool_}


class Array(Checked):
    """An array of a shape, a kind and a range.

    ``shape``: numbers, and names of dimensions, which must be the same wherever the name stands in
    one schema; None: any shape. What is read from lists is float64, int64 or bool; an array keeps
    its type.
    """

    def __init__(
        self,
        shape: Sequence[int | str] | None,
        kind: str = NUMBERS,
        minimum: float | None = None,
        maximum: float | None = None,
        finite: bool = True,
        nulls: bool = False,
        words: str = "",
        **options: Any,
    ) -> None:
        """``finite``: neither NaN nor infinity; ``nulls``: null in a list is NaN; ``words``: what
        it is, for users.
        """
        self.shape, self.kind, self.finite, self.nulls, self.words = (
            shape,
            kind,
            finite,
            nulls,
            words,
        )
        self.minimum, self.maximum = minimum, maximum
        place = "" if shape is None else f" in the shape {_shape_words(shape, {})}"
        super().__init__(words or f"{kind}{range_words(minimum, maximum)}{place}", **options)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> np.ndarray:
        array = value if isinstance(value, np.ndarray) else self._of_lists(value)
        if array.dtype.kind not in _KINDS[self.kind]:
            raise ValidationError(f"holds {array.dtype} values, expected {self.kind}")
        self._check_shape(array.shape)
        if array.size and self.kind != FLAGS:
            self._check_values(array)
        return array

    def _check_shape(self, shape: tuple[int, ...]) -> None:
        if self.shape is None:
            return
        sizes = getattr(self.root, "sizes", {})
        limits = getattr(self.root, "dimensions", {})
        meaning = f": {self.words}" if self.words else ""
        bad = ValidationError(
            f"has shape {shape}, expected {_shape_words(self.shape, sizes)}{meaning}"
        )
        if len(shape) != len(self.shape):
            raise bad
        for found, wanted in zip(shape, self.shape, strict=True):
            if isinstance(wanted, int):
                if found != wanted:
                    raise bad
                continue
            low, high = limits.get(wanted, (0, None))
            if found < low or (high is not None and found > high):
                raise ValidationError(
                    f"has shape {shape}, expected {_shape_words(self.shape, sizes)} with "
                    f"{wanted} from {low} to {high}"
                )
            if sizes.setdefault(wanted, found) != found:
                raise bad

    def _check_values(self, array: np.ndarray) -> None:
        low, high = array.min(), array.max()  # NaN where any is
        if not (math.isfinite(low) and math.isfinite(high)):
            if self.finite:
                raise ValidationError("holds NaN or infinity")
            known = array[np.isfinite(array)]
            low, high = known.min(initial=0), known.max(initial=0)
        if self.minimum is not None and low < self.minimum:
            raise ValidationError(
                f"holds {low:g}, expected {self.kind}{range_words(self.minimum, self.maximum)}"
            )
        if self.maximum is not None and high > self.maximum:
            raise ValidationError(
                f"holds {high:g}, expected {self.kind}{range_words(self.minimum, self.maximum)}"
            )

    def _of_lists(self, value: Any) -> np.ndarray:
        """An array of nested lists, all of whose entries are of this kind."""
        levels = 1 if self.shape is None else len(self.shape)
        shape: list[int] = []
        flat: list[Any] = [value]
        for _ in range(levels):
            if not all(isinstance(item, list | tuple) for item in flat):
                raise self.wrong(next(item for item in flat if not isinstance(item, list | tuple)))
            lengths = {len(item) for item in flat}
            if len(lengths) > 1:
                raise ValidationError(
                    f"has rows of {min(lengths)} and of {max(lengths)}, expected {self.expected}"
                )
            shape.append(lengths.pop() if lengths else 0)
            flat = [entry for item in flat for entry in item]
        kinds = _PYTHON[self.kind] + ((type(None),) if self.nulls else ())
        for index, entry in enumerate(flat):
            if type(entry) not in kinds:
                place = "".join(f"[{k}]" for k in np.unravel_index(index, shape))
                raise ValidationError({place: [f"is {shown(entry)}, expected one of {self.kind}"]})
        try:
            return np.array(
                [np.nan if entry is None else entry for entry in flat], _TYPES[self.kind]
            ).reshape(shape)
        except OverflowError as error:
            raise ValidationError("holds a number beyond all bounds") from error


def _shape_words(shape: Sequence[int | str], sizes: Mapping[str, int]) -> str:
    sides = [str(sizes.get(side, side)) if isinstance(side, str) else str(side) for side in shape]
    return f"({', '.join(sides)}{',' if len(sides) == 1 else ''})"


def rigid(matrix: Num[np.ndarray, "4 4"]) -> None:
    """Raise ValidationError unless a matrix is a rotation and a translation."""
    rotation = matrix[:3, :3]
    if (
        np.abs(rotation).max() > 2
        or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4)
        or np.linalg.det(rotation) < 0
        or not np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-9)
    ):
        raise ValidationError("is not a rigid 4x4 transform (rotation and translation, no scale)")


def unit(vectors: Num[np.ndarray, "... 3"]) -> None:
    """Raise ValidationError unless all vectors have length 1."""
    if vectors.size and not np.allclose(np.linalg.norm(vectors, axis=-1), 1, atol=1e-3):
        raise ValidationError("holds directions that are not of length 1")


class Words(Checked):
    """Text in an array without dimensions, as an .npz keeps it."""

    def __init__(self, **options: Any) -> None:
        super().__init__("text", **options)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> str:
        if not isinstance(value, np.ndarray) or value.shape != () or value.dtype.kind != "U":
            raise self.wrong(value)
        return str(value)
