"""JSON text that somebody else wrote, decoded within limits."""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import Any

import numpy as np

from facestage.contract.files.reading import MIB
from facestage.contract.wording import quoted

JSON_MAX = 16 * MIB  # of text; decoded it may be twenty times as much
DEPTH_MAX = 64  # lists and objects within each other

# Possessive, so that no text makes the search go back.
_STRING = re.compile(rb'"(?:[^"\\]++|\\.)*+"', re.DOTALL)
_NOT_BRACKETS = bytes(sorted(set(range(256)) - set(b"[]{}")))


def decode_json(content: bytes) -> Any:
    """The value of a JSON text in UTF-8. Raises ValueError, in a few words, for anything else.

    Beyond what JSON is: no NaN and no infinity, no key twice in an object, no number of thousands
    of digits, and at most DEPTH_MAX lists and objects within each other.
    """
    if len(content) > JSON_MAX:
        raise ValueError(
            f"{len(content) / MIB:.1f} MiB of text, expected at most {JSON_MAX // MIB}"
        )
    if depth(content) > DEPTH_MAX:
        raise ValueError(f"lists and objects more than {DEPTH_MAX} deep")
    try:
        # A mark at the beginning is what some editors of Windows write.
        return json.loads(
            content.decode("utf-8-sig"), parse_constant=_no_number, object_pairs_hook=_object
        )
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 at byte {error.start}") from error


def depth(content: bytes) -> int:
    """How many lists and objects of a JSON text lie within each other at most; decoding recurses as
    often.
    """
    brackets = np.frombuffer(_STRING.sub(b"", content).translate(None, _NOT_BRACKETS), np.uint8)
    if not len(brackets):
        return 0
    steps = np.where((brackets == ord("[")) | (brackets == ord("{")), np.int32(1), np.int32(-1))
    return int(np.cumsum(steps, dtype=np.int32).max())


def _no_number(name: str) -> Any:
    raise ValueError(f"{name} is no number in JSON, which has null for it")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise ValueError(f"the key {quoted(counts.most_common(1)[0][0])} is there twice")
    return result
