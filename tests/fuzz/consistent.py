"""Whether what a reader accepted is what its type says: plain types, finite numbers, arrays that
are arrays.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


class InconsistentError(Exception):
    """A reader accepted something that it must not."""


class RefusedError(Exception):
    """The command line refused its arguments with a sentence."""


def require(condition: object, what: str) -> None:
    if not condition:
        raise InconsistentError(what)


def check_dataclass(value: Any, but: tuple[str, ...] = ()) -> None:
    """Every field of ``value`` has the declared type and is finite, but for the fields named in
    ``but``.
    """
    hints = typing.get_type_hints(type(value))
    for field in dataclasses.fields(value):
        if field.name not in but:
            check(
                getattr(value, field.name),
                hints[field.name],
                f"{type(value).__name__}.{field.name}",
            )


def check(value: Any, kind: Any, what: str) -> None:
    origin = typing.get_origin(kind)
    if kind is Any:
        _check_any(value, what)
    elif origin in (types.UnionType, typing.Union):
        _check_union(value, typing.get_args(kind), what)
    elif origin is tuple:
        _check_tuple(value, typing.get_args(kind), what)
    elif origin is list:
        # Where nothing is added, a tuple serves as well.
        require(type(value) in (list, tuple), f"{what} is a {type(value).__name__}, not a list")
        for item in value:
            check(item, typing.get_args(kind)[0], f"{what}[]")
    elif origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        _check_mapping(value, typing.get_args(kind), what)
    elif kind is float:
        number = type(value) in (int, float) or isinstance(value, np.floating)
        require(number and math.isfinite(value), f"{what} is {value!r:.60}, not a finite number")
    elif kind is int:
        require(type(value) is int, f"{what} is {value!r:.60}, not a whole number")
    elif kind is np.ndarray:
        check_array(value, what)
    elif isinstance(kind, type) and dataclasses.is_dataclass(kind):
        require(
            isinstance(value, kind), f"{what} is a {type(value).__name__}, not a {kind.__name__}"
        )
        check_dataclass(value)
    elif kind is Path:
        require(isinstance(value, Path), f"{what} is a {type(value).__name__}, not a path")
    elif kind is type(None) or kind is None:
        require(value is None, f"{what} is {value!r:.60}, not None")
    elif isinstance(kind, type):
        require(type(value) is kind, f"{what} is {value!r:.60}, not a {kind.__name__}")


def check_array(value: Any, what: str) -> None:
    require(isinstance(value, np.ndarray), f"{what} is a {type(value).__name__}, not an array")
    require(value.dtype.kind in "biuf", f"{what} is an array of {value.dtype}")
    require(np.isfinite(value).all(), f"{what} holds NaN or infinity")


def _check_union(value: Any, kinds: tuple[Any, ...], what: str) -> None:
    reasons = []
    for kind in kinds:
        try:
            return check(value, kind, what)
        except InconsistentError as error:
            reasons.append(str(error))
    raise InconsistentError(reasons[0])


def _check_tuple(value: Any, kinds: tuple[Any, ...], what: str) -> None:
    require(type(value) is tuple, f"{what} is a {type(value).__name__}, not a tuple")
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(value)
    require(len(kinds) == len(value), f"{what} has {len(value)} entries, not {len(kinds)}")
    for item, kind in zip(value, kinds, strict=True):
        check(item, kind, f"{what}[]")


def _check_mapping(value: Any, kinds: tuple[Any, ...], what: str) -> None:
    require(isinstance(value, Mapping), f"{what} is a {type(value).__name__}, not a mapping")
    for key, item in value.items():
        check(key, kinds[0], f"{what}'s key")
        check(item, kinds[1], f"{what}[{key!r:.40}]")


def _check_any(value: Any, what: str) -> None:
    """Whatever it is, its numbers are finite."""
    if isinstance(value, float):
        require(math.isfinite(value), f"{what} is {value}")
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f":
            require(np.isfinite(value).all(), f"{what} holds NaN or infinity")
    elif isinstance(value, Mapping):
        for item in value.values():
            _check_any(item, what)
    elif isinstance(value, list | tuple):
        for item in value:
            _check_any(item, what)
