"""Imports Matplotlib so that no file of the user's changes what it draws."""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path


@cache
def load_matplotlib() -> None:
    """Import Matplotlib, which reads a ``matplotlibrc`` in the current folder first, and forget all
    settings found.
    """
    with contextlib.chdir(Path(__file__).resolve().parent):
        import matplotlib
    matplotlib.rcdefaults()
