"""How much memory this machine has, to say so before a picture asks for more."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.wording import whole_bytes

# Color, coverage, which part is skin, and the copies that are made when the picture is enlarged and
# written.
BYTES_PER_PIXEL = 64
_GROUP_LIMIT = Path("/sys/fs/cgroup/memory.max")


def check_picture(width: int, height: int, memory: int | None) -> None:
    """Raise InputError when a picture of so many pixels does not fit ``memory`` bytes; None: nobody
    knows.
    """
    needed = width * height * BYTES_PER_PIXEL
    if memory is not None and needed > memory:
        raise InputError(
            f"A picture of {width} x {height} pixels takes about {whole_bytes(needed)} of memory, "
            f"this machine has {whole_bytes(memory)}; render it on a larger one, or fit the photo "
            "at a smaller size."
        )


def machine_memory() -> int | None:
    """Bytes of memory that this process may use at most; None where the system does not say."""
    found = []
    with suppress(AttributeError, ValueError, OSError):  # Windows has no sysconf
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError):  # no control group, or one without a limit ("max")
        found.append(int(_GROUP_LIMIT.read_text(encoding="ascii")))
    return min((value for value in found if value > 0), default=None)
