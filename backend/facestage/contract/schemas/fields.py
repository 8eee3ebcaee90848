"""What a value in a file may be, as marshmallow fields that believe nothing: text is no number and
1 is not true.

Each says in words what it expects; an error is what was found and those words
(:func:`.schema.checked` makes the sentence). Lists and objects stop at their first wrong entry, so
that a file of a million errors costs as much as one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from marshmallow import Schema, ValidationError, fields

from facestage.contract.files.paths import PATH_MAX
from facestage.contract.wording import shown

TEXT_MAX = 20_000  # characters
NAME_MAX = 1_000
ENTRIES_MAX = 100_000
MISSING = "is missing"


class Checked(fields.Field[Any]):
    """A field whose errors say what was found and what was expected."""

    def __init__(self, expected: str, required: bool = True, **options: Any) -> None:
        """``expected``: in words; ``options``: marshmallow's."""
        super().__init__(
            required=required and "load_default" not in options,
            error_messages={
                "required": f"{MISSING}, expected {expected}",
                "null": f"is null, expected {expected}",
            },
            **options,
        )
        self.expected = expected

    def wrong(self, found: object) -> ValidationError:
        """The error of a value that was found."""
        return ValidationError(f"is {shown(found)}, expected {self.expected}")


class Text(Checked):
    """Text that can be written anywhere: no lone surrogates, no null characters."""

    def __init__(
        self, minimum: int = 0, maximum: int = TEXT_MAX, expected: str = "text", **options: Any
    ) -> None:
        """``minimum`` and ``maximum``: characters."""
        super().__init__(expected, **options)
        self.minimum, self.maximum = minimum, maximum

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> str:
        if not isinstance(value, str) or len(value) < self.minimum:
            raise self.wrong(value)
        if len(value) > self.maximum:
            raise ValidationError(f"has {len(value)} characters, expected at most {self.maximum}")
        if not writable(value):
            raise ValidationError(f"is {shown(value)}, which holds characters that no text has")
        return str(value)


class Name(Text):
    """Text of at least one character."""

    def __init__(self, maximum: int = NAME_MAX, **options: Any) -> None:
        """``maximum``: characters."""
        super().__init__(1, maximum, "text that is not empty", **options)


class PathText(Text):
    """A path as text."""

    def __init__(self, **options: Any) -> None:
        super().__init__(1, PATH_MAX, "a path", **options)


class Choice(Checked):
    """One of some words."""

    def __init__(self, choices: Sequence[str], **options: Any) -> None:
        super().__init__(f"one of {', '.join(choices)}", **options)
        self.choices = frozenset(choices)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> str:
        if not isinstance(value, str) or value not in self.choices:
            raise self.wrong(value)
        return value


class Flag(Checked):
    """True or false."""

    def __init__(self, **options: Any) -> None:
        super().__init__("true or false", **options)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> bool:
        if not isinstance(value, bool):
            raise self.wrong(value)
        return value


class Number(Checked):
    """A finite number within a range, as a float."""

    def __init__(
        self, minimum: float | None = None, maximum: float | None = None, **options: Any
    ) -> None:
        super().__init__(f"a number{range_words(minimum, maximum)}", **options)
        self.minimum, self.maximum = minimum, maximum

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not within(value, self):
            raise self.wrong(value)
        return float(value)


class Whole(Checked):
    """A whole number within a range, as an int; 96.0 is one."""

    def __init__(self, minimum: int, maximum: int, **options: Any) -> None:
        super().__init__(f"a whole number{range_words(minimum, maximum)}", **options)
        self.minimum, self.maximum = minimum, maximum

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> int:
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        if not numeric or not within(value, self) or value != int(value):
            raise self.wrong(value)
        return int(value)


class Items(Checked):
    """A list, as a tuple, of entries of one kind."""

    def __init__(
        self,
        entry: Checked,
        minimum: int = 0,
        maximum: int = ENTRIES_MAX,
        unique: bool = False,
        **options: Any,
    ) -> None:
        """``unique``: no two entries may be the same."""
        most = "" if maximum == ENTRIES_MAX else f", at most {maximum}"
        super().__init__(f"a list of {entry.expected} each{most}", **options)
        self.entry, self.minimum, self.maximum, self.unique = entry, minimum, maximum, unique

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise self.wrong(value)
        if not self.minimum <= len(value) <= self.maximum:
            raise ValidationError(
                f"has {len(value)} entries, expected {self.minimum} to {self.maximum}"
            )
        result = tuple(_entry(index, self.entry, item) for index, item in enumerate(value))
        if self.unique and len(set(result)) < len(result):
            twice = next(item for index, item in enumerate(result) if item in result[:index])
            raise ValidationError(f"has {shown(twice)} twice, expected each once")
        return result


class Table(Checked):
    """An object of names and entries of one kind, as a dict."""

    def __init__(self, entry: Checked, maximum: int = ENTRIES_MAX, **options: Any) -> None:
        super().__init__(f"an object of names with {entry.expected} each", **options)
        self.entry, self.maximum = entry, maximum

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise self.wrong(value)
        if len(value) > self.maximum:
            raise ValidationError(f"has {len(value)} entries, expected at most {self.maximum}")
        for name in value:
            if not isinstance(name, str) or not writable(name) or len(name) > NAME_MAX:
                raise ValidationError(
                    f"has the name {shown(name)}, expected text of at most {NAME_MAX} characters"
                )
        return {name: _entry(name, self.entry, item) for name, item in value.items()}


class Figures(Table):
    """An object of names with a number each.

    A null, which is how NaN is written, is as good as missing.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(Number(allow_none=True), **options)

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> dict[str, Any]:
        found = super()._deserialize(value, attr, data, **kwargs)
        return {name: number for name, number in found.items() if number is not None}


class Plain(Checked):
    """Anything that JSON can say, for what is only shown."""

    def __init__(self, **options: Any) -> None:
        super().__init__("plain values", allow_none=True, **options)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> Any:
        if isinstance(value, str) and not writable(value):
            raise self.wrong(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise self.wrong(value)
        if isinstance(value, Mapping):
            return {name: _entry(name, self, item) for name, item in value.items()}
        return (
            [_entry(index, self, item) for index, item in enumerate(value)]
            if isinstance(value, list)
            else value
        )


class Part(Checked):
    """An object with a schema of its own."""

    def __init__(
        self, schema: Callable[[], Schema], expected: str = "an object", **options: Any
    ) -> None:
        super().__init__(expected, **options)
        self.make = schema

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> Any:
        if not isinstance(value, Mapping):
            raise self.wrong(value)
        return self.make().load(value)


def range_words(minimum: float | None, maximum: float | None) -> str:
    """A range as a sentence says it."""
    if minimum is None and maximum is None:
        return ""
    if maximum is None:
        return f" of {minimum:g} or more"
    low = "at most" if minimum is None else f"{_plain(minimum)} to"
    return f" of {low} {_plain(maximum)}"


def within(value: int | float, limits: Any) -> bool:
    """Whether a number is finite, also as a float, and between ``limits.minimum`` and
    ``limits.maximum``.
    """
    try:
        finite = math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False
    low, high = limits.minimum, limits.maximum
    return finite and (low is None or value >= low) and (high is None or value <= high)


def writable(text: str) -> bool:
    """Whether a text can be written as UTF-8, and handed to a library in C."""
    try:
        return b"\0" not in text.encode()
    except UnicodeEncodeError:
        return False


def _plain(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def _entry(place: str | int, field: Checked, value: Any) -> Any:
    """An entry of a list or an object, its error under its place there."""
    try:
        return field.deserialize(value)
    except ValidationError as error:
        raise ValidationError({place: error.messages}) from error
