"""What numpy 2 refuses, refused with numpy 1 too: the tests run with 1, Blender 5.1 has 2."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

OURS = ("facestage.", "facestage_blender.")


def hold_to_numpy_2() -> None:
    """Let no module of ours take the cross product of vectors of two numbers."""
    known = np.cross

    def cross(a: Any, b: Any, *arguments: Any, **options: Any) -> Any:
        caller = sys._getframe(1).f_globals.get("__name__", "")
        if caller.startswith(OURS) and 2 in (np.shape(a)[-1:] + np.shape(b)[-1:]):
            raise ValueError("numpy 2 takes no cross product of vectors of two numbers")
        return known(a, b, *arguments, **options)

    setattr(np, "cross", cross)  # noqa: B010  # which numpy declares constant
