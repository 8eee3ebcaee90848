"""The table as text, HTML and JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from facestage.contract.errors import InputError
from facestage.report.stress import (
    StressRow,
    build_stress_page,
    head_lines,
    row_lines,
    summary_line,
    write_stress_report,
)

GOOD = StressRow(
    "plain",
    "nothing extreme",
    "converged",
    "Converged: fine.",
    (),
    0.163,
    1.018,
    42.27,
    458.8,
    23,
    6.31,
)
REFUSED = StressRow(
    "dark",
    "all <off>",
    "refused",
    "All lights are off & dark.",
    (),
    None,
    None,
    None,
    None,
    0,
    0.01,
)
WRONG = replace(
    GOOD,
    name="liar",
    faults=("silently wrong: 9.00 mm",),
    mm=9.0,
    warnings=("overflow (solver.py:1)",),
)


def test_numbers_stand_below_their_heads() -> None:
    head, rule = head_lines()
    (line,) = row_lines(GOOD)
    assert len(line) == len(head) == len(rule)
    ends = {
        word: head.index(word) + len(word) for word in ("mm", "start", "dB", "condition", "steps")
    }
    values = {"mm": "0.16", "start": "1.02", "dB": "42.3", "condition": "4.6e+02", "steps": "23"}
    assert {word: line[: ends[word]].split()[-1] for word in ends} == values
    assert line.endswith("6.3")


def test_what_was_said_follows_unless_it_converged() -> None:
    assert len(row_lines(GOOD)) == 1
    assert row_lines(REFUSED)[1].strip() == "All lights are off & dark."
    first, fault, warning = row_lines(WRONG)
    assert first.startswith("FAIL")
    assert "silently wrong" in fault and "overflow" in warning


def test_missing_numbers_are_dashes() -> None:
    assert row_lines(REFUSED)[0].count("–") == 5


def test_summary_counts_and_names_who_failed() -> None:
    assert summary_line([GOOD, REFUSED]).startswith(
        "2 cases in 6 s: 1 converged, 0 stopped with advice, 1 refused"
    )
    assert "none is NaN" in summary_line([GOOD, REFUSED])
    assert summary_line([GOOD, WRONG]).endswith("FAILED: liar.")


class _Page(HTMLParser):
    VOID = frozenset(("meta", "br"))

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows = 0
        self.text = ""
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.rows += tag == "tr"
        self.links += [value or "" for name, value in attributes if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_page_is_well_formed_and_needs_no_other_file() -> None:
    page = _Page()
    page.feed(build_stress_page([GOOD, REFUSED, WRONG]))
    assert page.open == [] and page.links == []
    assert page.rows == 4
    assert "all <off>" in page.text and "All lights are off & dark." in page.text
    assert "silently wrong: 9.00 mm" in page.text


def test_report_is_written_in_three_forms(tmp_path: Path) -> None:
    write_stress_report(tmp_path / "new", [GOOD, WRONG])
    assert {path.name for path in (tmp_path / "new").iterdir()} == {
        "stress.html",
        "stress.txt",
        "stress.json",
    }
    data = json.loads((tmp_path / "new" / "stress.json").read_text(encoding="utf-8"))
    assert [(case["name"], case["passed"]) for case in data["cases"]] == [
        ("plain", True),
        ("liar", False),
    ]
    assert "FAILED: liar" in (tmp_path / "new" / "stress.txt").read_text(encoding="utf-8")


def test_a_file_in_the_way_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="Cannot make the folder"):
        write_stress_report(tmp_path / "file", [GOOD])
