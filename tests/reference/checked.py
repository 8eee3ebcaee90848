"""Checks the annotations of calls while the tests run, the shapes of arrays among them.

Importing this module is enough, before any of what it checks is imported.

jaxtyping's own wrapper binds the arguments of each call anew and looks at them twice, which costs a
fit a fifth of its time. Here a call is looked at once, by beartype, and one that no array goes into
or comes out of, by beartype alone. What is checked is the same, in the first calls of a function
that each test makes: a fit repeats itself ten thousand times, which cost its tests a quarter of
their time.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import io
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import IO, Any, Self, cast, get_args, get_type_hints

import jaxtyping
import numpy as np
from beartype import BeartypeConf, BeartypeHintOverrides, beartype

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
_beartype: Any = beartype(
    conf=BeartypeConf(hint_overrides=_MEANT, violation_type=jaxtyping.TypeCheckError)
)


# Of a function, in one test.
FIRST_CALLS = 6
_calls: Counter[Callable[..., Any]] = Counter()


def begin_test() -> None:
    """From here on calls are first ones again."""
    _calls.clear()


def checked(thing: Any) -> Any:
    """A function, or a dataclass, with its annotations checked at its first calls in a test.

    A dataclass may refuse in its own words what it is made of, so that is looked at after.
    """
    if isinstance(thing, type):
        if dataclasses.is_dataclass(thing) and "__init__" in vars(thing):
            made = thing.__init__
            cast(Any, thing).__init__ = _at_first(made, _checked_after(made))
        return thing
    if thing.__qualname__.endswith(".__init__"):
        return _at_first(thing, _checked_after(thing))
    hints = _hints(thing)
    if inspect.isgeneratorfunction(thing):
        return _at_first(thing, _checked_before(thing, hints))
    thing.__annotations__ = hints
    return _at_first(thing, _within(hints, _beartype(thing)))


def _at_first(function: Callable[..., Any], check: Callable[..., Any]) -> Callable[..., Any]:
    """``check``, and once it was called as often as is enough, ``function`` itself."""

    @functools.wraps(check)
    def call(*arguments: Any, **named: Any) -> Any:
        if _calls[function] >= FIRST_CALLS:
            return function(*arguments, **named)
        _calls[function] += 1
        return check(*arguments, **named)

    return call


def _checked_after(function: Callable[..., None]) -> Callable[..., None]:
    hints = _hints(function)
    check = _within(hints, _beartype(_without_body(function, hints)))

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> None:
        function(*arguments, **named)
        check(*arguments, **named)

    return call


def _checked_before(function: Callable[..., Any], hints: dict[str, Any]) -> Callable[..., Any]:
    """A generator, whose body begins to run later: what it is given is looked at when it is."""
    given = {name: hint for name, hint in hints.items() if name != "return"}
    check = _within(given, _beartype(_without_body(function, given)))

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        check(*arguments, **named)
        return function(*arguments, **named)

    return call


def _within(hints: dict[str, Any], function: Callable[..., Any]) -> Callable[..., Any]:
    """The function in a scope of its own, in which a name in a shape is one length."""
    if not any(map(_holds_arrays, hints.values())):
        return function

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        with _SCOPE:
            return function(*arguments, **named)

    return call


_SCOPE = jaxtyping.jaxtyped("context")


def _holds_arrays(hint: Any) -> bool:
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return any(_holds_arrays(part) for part in get_args(hint))


def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """The annotations as types, without those that only a type checker can read."""
    hints: dict[str, Any] = {}
    for name, annotation in function.__annotations__.items():
        alone = SimpleNamespace(__annotations__={name: annotation})
        with suppress(NameError, AttributeError, TypeError):
            hints |= get_type_hints(alone, function.__globals__, include_extras=True)
    return hints


def _without_body(function: Callable[..., Any], hints: dict[str, Any]) -> Callable[..., None]:
    """A function of the same parameters that does nothing."""
    bare = [
        parameter.replace(default=parameter.empty, annotation=parameter.empty)
        for parameter in inspect.signature(function).parameters.values()
    ]
    scope: dict[str, Any] = {}
    exec(f"def check{inspect.Signature(bare)}: pass", scope)
    check = scope["check"]
    check.__module__, check.__qualname__ = function.__module__, function.__qualname__
    check.__defaults__, check.__kwdefaults__ = function.__defaults__, function.__kwdefaults__
    check.__annotations__ = hints
    return check


# The hook puts `@jaxtyping.jaxtyped(...)` on each function and class.
cast(Any, jaxtyping).jaxtyped = lambda **_: checked
jaxtyping.install_import_hook(CHECKED, None)
