"""Arrays in annotations, with their element type and shape: ``Float[np.ndarray, "pixels 3"]``.

``Float``, ``Int``, ``Bool`` and the others are those of jaxtyping while the tests run, which check
each call and each dataclass (tests/reference/checked.py). Everywhere else they are
``typing.Annotated``: nothing is imported and nothing is checked, in Blender as in a fit.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING or "jaxtyping" not in sys.modules:
    from typing import Annotated as Bool
    from typing import Annotated as Float
    from typing import Annotated as Float32
    from typing import Annotated as Float64
    from typing import Annotated as Int
    from typing import Annotated as Int32
    from typing import Annotated as Int64
    from typing import Annotated as Integer
    from typing import Annotated as Num
    from typing import Annotated as Shaped
    from typing import Annotated as UInt8
else:
    from jaxtyping import (
        Bool,
        Float,
        Float32,
        Float64,
        Int,
        Int32,
        Int64,
        Integer,
        Num,
        Shaped,
        UInt8,
    )

__all__ = [
    "Bool",
    "Float",
    "Float32",
    "Float64",
    "Int",
    "Int32",
    "Int64",
    "Integer",
    "Num",
    "Shaped",
    "UInt8",
]
