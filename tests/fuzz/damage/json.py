"""Damage to JSON: any value becomes any other, keys go and come, numbers and nesting leave every
range.
"""

from __future__ import annotations

import copy
import json
from typing import Any

from fuzz.choice import Choose
from fuzz.damage.bytes import mangle_bytes

# Texts that no Python value is written as: put in place of a marker.
_RAW = (
    "NaN",
    "Infinity",
    "-Infinity",
    "1e400",
    "-1e400",
    "1" + "0" * 400,
    "9" * 5000,
    "-" + "9" * 25,
    "1e308",
    "5e-324",
    "-0.0",
    "[" * 100_000 + "]" * 100_000,
    '{"a":' * 50_000 + "1" + "}" * 50_000,
    "[" * 300 + "]" * 300,
    '"' + "x" * 100_000 + '"',
    '"\\ud800"',
    '"\\u0000"',
    '"a\\nb\\u001b[31mTraceback"',
    '"../../../../etc/passwd"',
    '"/dev/zero"',
    '"~nosuchuser/x"',
    '"' + "a/" * 2500 + '"',
    "[" + "0," * 200_000 + "0]",
)
_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    2**31,
    2**53 + 1,
    2**63,
    10**30,
    0.5,
    -0.5,
    1e-300,
    1e300,
    "",
    "a",
    "5",
    "NaN",
    "default",
    [],
    [1],
    [[]],
    [None],
    ["a"],
    [1, "a"],
    [[1, 2], [3]],
    {},
    {"a": 1},
    {"": None},
)
_MARK = "@raw@"


def mangle_json(choose: Choose, data: bytes) -> bytes:
    """A JSON text with one to three values changed."""
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return mangle_bytes(choose, data)
    raw = None
    for _ in range(choose.one_of((1, 1, 1, 2, 3))):
        value, found = _changed(choose, value)
        raw = found or raw
    text = json.dumps(value)
    if raw is not None:
        text = text.replace(f'"{_MARK}"', raw)
    return text.encode("utf-8", "surrogatepass")


def _changed(choose: Choose, root: Any) -> tuple[Any, str | None]:
    """The tree with one change, and the text that its marker stands for."""
    places = list(_places(root))
    if not places or choose.chance(25):
        return _value(choose)
    parent, key = choose.one_of(places)
    action = choose.number(0, 9)
    raw = None
    if action < 6:
        parent[key], raw = _value(choose)
    elif action == 6:
        del parent[key]
    elif action == 7 and isinstance(parent, dict):
        parent[choose.text()] = parent.pop(key)
    elif action == 8 and isinstance(parent, dict):
        other = choose.one_of(list(parent))
        parent[key], parent[other] = parent[other], parent[key]
    elif isinstance(parent, list):
        parent.insert(choose.number(0, len(parent)), parent[key])
    else:
        parent[choose.text()] = choose.json()
    return root, raw


def _value(choose: Choose) -> tuple[Any, str | None]:
    kind = choose.number(0, 5)
    if kind < 2:
        return _MARK, choose.one_of(_RAW)
    # A copy: what comes later may change it.
    return (copy.deepcopy(choose.one_of(_VALUES)) if kind < 5 else choose.json()), None


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) below ``value``, the shallow ones first; of long lists the ends."""
    found, waiting = [], [value]
    while waiting:
        node = waiting.pop(0)
        keys: list[Any] = []
        if isinstance(node, dict):
            keys = list(node)
        elif isinstance(node, list):
            keys = list(range(len(node)))[:4] + ([len(node) - 1] if len(node) > 4 else [])
        found += [(node, key) for key in keys]
        waiting += [node[key] for key in keys]
    return found
