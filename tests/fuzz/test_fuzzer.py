"""The fuzzer itself: it finds every fault that is planted, repeats an input by its number, and
shrinks.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from fuzz import planted
from fuzz.campaign import Campaign
from fuzz.case import ENDLESS, FIFO, FOLDER, LOOP, Case, keep, lay_out, read_back
from fuzz.pool import Hand, Outcome
from fuzz.shrink import shrunk
from fuzz.targets import TARGETS, counts
from fuzz.worker import ACCEPTED, FINDING, REFUSED

SECONDS = 1.5  # of a planted hang


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hand]:
    made = Hand(tmp_path_factory.mktemp("fuzz"), "fuzz.planted", SECONDS)
    yield made
    made.stop()


def outcomes(hand: Hand, target: str, count: int = 1) -> list[Outcome]:
    return list(hand.run(target, 0, range(count)))


@pytest.mark.parametrize("name", [name for name, kind in planted.KINDS.items() if kind])
def test_every_planted_fault_is_found(hand: Hand, name: str) -> None:
    # Of the inputs for "traceback" some hold the byte that it stumbles over.
    found = [
        one
        for one in outcomes(hand, name, 40 if name == "traceback" else 1)
        if one.verdict == FINDING
    ]
    assert found and {one.kind for one in found} == {planted.KINDS[name]}


def test_what_is_right_is_no_finding(hand: Hand) -> None:
    assert {one.verdict for one in outcomes(hand, "fine", 5)} == {ACCEPTED}
    assert {one.verdict for one in outcomes(hand, "refuses", 5)} == {REFUSED}


def test_the_run_goes_on_after_a_crash(hand: Hand) -> None:
    assert [one.number for one in outcomes(hand, "crash", 3)] == [0, 1, 2]
    assert outcomes(hand, "fine")[0].verdict == ACCEPTED


def test_a_finding_is_shrunk_to_what_it_needs(hand: Hand, tmp_path: Path) -> None:
    found = next(one for one in outcomes(hand, "traceback", 200) if one.verdict == FINDING)
    case = planted.TARGETS["traceback"].case([{"a.bin": bytes(range(64))}], 0, found.number)
    assert case is not None
    assert shrunk(hand, "traceback", case, found, tmp_path / "candidate") == {"a.bin": b"\xff"}


@pytest.mark.parametrize("name", ["json", "job", "pickle", "photo", "command"])
def test_an_input_is_known_by_its_number(name: str) -> None:
    target = TARGETS[name]
    seeds, again = target.seeds(), target.seeds()
    assert seeds == again, "seeds hold something of the day that they were made"
    cases = [target.case(seeds, 3, number) for number in range(8)]
    assert cases == [target.case(again, 3, number) for number in range(8)]
    assert len({repr(case) for case in cases}) > 5
    assert cases != [target.case(seeds, 4, number) for number in range(8)]


def test_a_case_survives_being_kept(tmp_path: Path) -> None:
    case: Case = {
        "a/b.json": b"{}",
        "c": b"",
        f"d{FIFO}": b"",
        f"e{ENDLESS}": b"",
        f"f{FOLDER}": b"",
        f"g{LOOP}": b"",
    }
    keep(case, tmp_path / "kept")
    assert read_back(tmp_path / "kept") == case
    lay_out(case, tmp_path / "laid")
    assert (tmp_path / "laid/d").is_fifo() and (tmp_path / "laid/f").is_dir()
    assert (tmp_path / "laid/e").readlink() == Path("/dev/zero") and (
        tmp_path / "laid/g"
    ).is_symlink()


def test_findings_of_one_cause_are_told_once() -> None:
    campaign = Campaign()
    one = Outcome("json", 0, 7, FINDING, "KeyError", "a.py:f", "text")
    assert campaign.add(one)
    assert not campaign.add(Outcome("json", 0, 3, FINDING, "KeyError", "a.py:f", "text"))
    assert campaign.add(Outcome("json", 0, 9, FINDING, "KeyError", "a.py:g", "text"))
    assert campaign.findings[one.signature].number == 3 and campaign.repeats[one.signature] == 2


def test_every_reader_gets_its_share() -> None:
    shares = counts(100_000)
    assert abs(sum(shares.values()) - 100_000) < len(shares)
    assert min(shares.values()) > 50
