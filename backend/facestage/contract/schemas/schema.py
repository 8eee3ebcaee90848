"""One schema says what a file holds; one function checks a file against it and says in a sentence
what is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from marshmallow import EXCLUDE, RAISE, Schema, ValidationError

from facestage.contract.errors import InputError
from facestage.contract.files.json_text import decode_json
from facestage.contract.schemas.fields import MISSING
from facestage.contract.wording import escaped, quoted, shown

_OWN = "_schema"  # where marshmallow puts what is wrong with a whole


class FileSchema(Schema):
    """What an object in a file holds.

    Other keys are ignored: a newer version of the project may have written them.
    """

    # The least and the largest number of entries along a named dimension of the arrays.
    dimensions: ClassVar[Mapping[str, tuple[int, int]]] = {}

    class Meta:
        """Of marshmallow."""

        unknown = EXCLUDE

    def __init__(self, **sizes: int) -> None:
        """``sizes`` of named dimensions that are known already."""
        super().__init__()
        self.sizes = dict(sizes)


class HandWritten(FileSchema):
    """What a file that people write holds: a key that is not known is a slip of theirs, and not
    ignored.
    """

    class Meta:
        """Of marshmallow."""

        unknown = RAISE


def checked(
    schema: FileSchema, data: Mapping[str, Any], subject: str, remedy: str = ""
) -> dict[str, Any]:
    """What ``schema`` makes of ``data``.

    Raises InputError: ``subject``, the first value that is wrong, ``remedy``.
    """
    try:
        return dict(schema.load(data))
    except ValidationError as error:
        problem = _problem(error.messages, schema)
        raise InputError(f"{subject}{problem}{f'; {remedy}' if remedy else ''}.") from error


def check_version(data: Mapping[str, Any], version: int, subject: str, remedy: str) -> None:
    """Raise InputError unless the file is of this ``version`` of its schema."""
    found = data.get("schema")
    if type(found) is not int or found != version:
        raise InputError(f"{subject} has schema {shown(found)}, expected {version}; {remedy}.")


def decoded_meta(text: str, subject: str, remedy: str) -> dict[str, Any]:
    """The object of JSON that an .npz keeps beside its arrays.

    Raises InputError where it is none.
    """
    try:
        meta = decode_json(text.encode())
    except ValueError as error:
        raise InputError(f"{subject} has damaged meta data ({error}); {remedy}.") from error
    if not isinstance(meta, dict):
        raise InputError(
            f"{subject} has damaged meta data ({shown(meta)}, expected an object); {remedy}."
        )
    return meta


def sections(arrays: Mapping[str, np.ndarray], *names: str) -> dict[str, Any]:
    """Arrays of an .npz with those called NAME/... as an object NAME of their own; without any,
    there is none.
    """
    result: dict[str, Any] = {}
    plain: dict[str, Any] = {}
    for key, array in arrays.items():
        name, slash, rest = key.partition("/")
        if slash and name in names:
            result.setdefault(name, {})[rest] = array
        else:
            plain[key] = array
    # An array with the name of an object takes its place, and is refused there.
    return result | plain


def _problem(messages: Any, schema: Schema) -> str:
    path = ""
    while isinstance(messages, Mapping):
        key = next(iter(messages))
        messages = messages[key]
        if key != _OWN:
            path += _step(key, bool(path))
    words = str(messages[0] if isinstance(messages, list) else messages)
    if words == schema.error_messages["unknown"]:
        return f": {path} is not known, expected {', '.join(schema.fields)}"
    if words.startswith(MISSING):
        return f" lacks {path}{words.removeprefix(MISSING)}"
    return f": {path} {words}" if path else f" {words}"


def _step(key: object, inner: bool) -> str:
    """A key in the path of a value."""
    if isinstance(key, int):
        return f"[{key}]"
    text = str(key)
    if text.startswith("["):
        return escaped(text)
    simple = len(text) <= 60 and text.replace("/", "").replace("_", "").replace("-", "").isalnum()
    return ("." if inner else "") + (text if simple else quoted(text))
