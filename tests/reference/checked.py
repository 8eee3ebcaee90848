"""Checks the annotations of calls while the tests run, the shapes of arrays among them.

Importing this module is enough, before any of what it checks is imported.
"""

from __future__ import annotations

import inspect
import io
from collections.abc import Callable
from typing import IO, Any, Self, cast

import numpy as np
from beartype import BeartypeConf, BeartypeHintOverrides, beartype
from jaxtyping import install_import_hook

# Packages whose calls are checked.
CHECKED = (
    "facestage.contract",
    "facestage.fit.energy",
    "facestage.fit.face",
    "facestage.fit.forward",
    "facestage.fit.textures",
)

# numpy's numbers are no Python numbers, and a member of an archive is no IO: both are meant.
_MEANT = cast(Any, BeartypeHintOverrides)(
    {
        float: float | int | np.floating | np.integer,
        int: int | np.integer,
        bool: bool | np.bool_,
        IO[bytes]: IO[bytes] | io.BufferedIOBase,
        Self: object,  # the class is not known here
    }
)
_beartype: Any = beartype(conf=BeartypeConf(hint_overrides=_MEANT))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its annotations checked at each call.

    jaxtyping gives a function twice: with its parameters alone before it runs, with what it returns
    after. A dataclass may refuse in its own words what it is made of, so it is looked at after.
    """
    before = inspect.signature(function).return_annotation is Any
    is_constructor = function.__qualname__.endswith(".__init__")
    return function if before and is_constructor else _beartype(function)


install_import_hook(CHECKED, f"{__name__}.{checked.__name__}")
