"""The smallest input of a finding that simple means reach: fewer files, seeds in place of damage,
shorter ones.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from fuzz.case import Case, keep
from fuzz.pool import Hand, Outcome

TRIES = 150


def shrunk(
    hand: Hand, target: str, case: Case, found: Outcome, folder: Path, tries: int = TRIES
) -> Case:
    """A smaller case with the same signature as ``found``; after ``tries`` readings the best so
    far.
    """
    left = tries

    def same(candidate: Case) -> bool:
        nonlocal left
        left -= 1
        if left < 0:
            return False
        keep(candidate, folder)
        return hand.read_folder(target, folder).signature == found.signature

    for name in list(case):
        candidate = {other: content for other, content in case.items() if other != name}
        if candidate and same(candidate):
            case = candidate
    for name in sorted(case, key=lambda key: -len(case[key])):
        others = {other: content for other, content in case.items() if other != name}
        case = others | {name: _shorter(case[name], partial(_with, same, others, name))}
    return case


def _with(same: Callable[[Case], bool], others: Case, name: str, content: bytes) -> bool:
    return same(others | {name: content})


def _shorter(content: bytes, same: Callable[[bytes], bool]) -> bytes:
    """``content`` without every chunk that may go, chunks halved from half of it down to single
    bytes.
    """
    size = len(content) // 2
    while size:
        start = 0
        while start < len(content):
            candidate = content[:start] + content[start + size :]
            if same(candidate):
                content = candidate
            else:
                start += size
        size //= 2
    return content
