"""Loads the shared libraries that the set-up unpacked into the environment because the machine
lacks them.

Copied into the environment's site-packages by tools/setup_native.py. The dynamic loader does not
look for a library whose name is loaded already, which is how packages find these without
LD_LIBRARY_PATH.
"""

import contextlib
import ctypes
import sys
from pathlib import Path


def load() -> None:
    """Load each library that native/preload.txt lists, in its order (a library after those it
    needs).
    """
    environment = Path(sys.prefix)
    listing = environment / "native" / "preload.txt"
    if not listing.is_file():
        return
    for line in listing.read_text().splitlines():
        # A library that no longer loads is named in the ImportError of the package that needs it.
        with contextlib.suppress(OSError):
            ctypes.CDLL(str(environment / line))
