"""Whether two results, or two persons' folders, say the same: everything but times, to the bit."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.files.storage import read_arrays
from facestage.images.image_io import read_exr

# A chart and a page of seconds.
TIMED = ("trace.png", "report.html")

RATE = r", about [0-9.e+-]+ s at this run's [0-9.e+-]+( thousand| million| billion)? a second"


def differences(one: Path, other: Path) -> list[str]:
    """What differs between two folders, a line for each file."""
    files = [
        {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
        for folder in (one, other)
    ]
    found = [f"{name}: only one of them has it" for name in sorted(files[0] ^ files[1])]
    for name in sorted(files[0] & files[1]):
        said = _difference(one / name, other / name)
        if said:
            found.append(f"{name}: {said}")
    return found


def _difference(one: Path, other: Path) -> str:
    if one.name in TIMED or one.read_bytes() == other.read_bytes():
        return ""
    if one.suffix == ".npz":
        return _arrays(read_arrays(one, "result"), read_arrays(other, "result"))
    if one.suffix == ".exr":
        return _arrays({"pixels": read_exr(one)}, {"pixels": read_exr(other)})
    if one.suffix == ".json":
        return _values(
            _untimed(json.loads(one.read_text())), _untimed(json.loads(other.read_text()))
        )
    if one.suffix == ".jsonl":
        first, second = (
            [_untimed(json.loads(line)) for line in path.read_text().splitlines()]
            for path in (one, other)
        )
        return _values(first, second)
    return "its bytes differ"


def _rows(path: Path) -> list[Any]:
    return [_untimed(json.loads(line)) for line in path.read_text().splitlines()]


def _arrays(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> str:
    if set(one) != set(other):
        return f"only one has {sorted(set(one) ^ set(other))}"
    unequal = [
        name
        for name, array in one.items()
        if (array.dtype, array.shape, array.tobytes())
        != (other[name].dtype, other[name].shape, other[name].tobytes())
    ]
    return f"{', '.join(unequal)} differ" if unequal else ""


def _values(one: Any, other: Any, where: str = "") -> str:
    """The first place where two decoded JSON values differ."""
    if isinstance(one, dict) and isinstance(other, dict) and set(one) == set(other):
        pairs = [(f"{where}.{key}", one[key], other[key]) for key in one]
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = [
            (f"{where}[{index}]", *both) for index, both in enumerate(zip(one, other, strict=True))
        ]
    else:
        return "" if one == other else f"{where or 'all'}: {str(one)[:60]} and {str(other)[:60]}"
    return next((said for place, a, b in pairs if (said := _values(a, b, place))), "")


def _untimed(value: Any) -> Any:
    """Without seconds, and without what is reckoned from them."""
    if isinstance(value, dict):
        return {
            key: _untimed(item) for key, item in value.items() if key not in ("timings", "seconds")
        }
    if isinstance(value, list):
        return [_untimed(item) for item in value]
    if isinstance(value, str):
        return re.sub(
            r", about [0-9.e+-]+ s at this run's [0-9.e+-]+( thousand| million| billion)? a second",
            "",
            value,
        )
    return value
