"""What a test knows to be there, said so that the type checker and the reader know it too."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def known(value: T | None) -> T:
    """``value``, which is not None: a test that is wrong about it fails here."""
    assert value is not None
    return value
