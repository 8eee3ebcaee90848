"""The journal of a batch."""

from __future__ import annotations

from pathlib import Path

from facestage.contract.batch import FAILED, JOURNAL, BatchRow, read_journal
from facestage.contract.result import CONVERGED

GOOD = BatchRow(1, "a", ("/a.png",), CONVERGED, "Well.", "0f", 2.5, {"psnr_skin": 31.0})
BAD = BatchRow(2, "b", ("/b.png", "/c.png"), FAILED, "No face.", "1f", 0.5)


def test_a_row_comes_back_from_its_line():
    assert [BatchRow.from_line(row.to_line().encode()) for row in (GOOD, BAD)] == [GOOD, BAD]
    assert BAD.failed and not GOOD.failed


def test_the_last_line_of_a_name_counts_and_what_was_cut_off_does_not(tmp_path: Path):
    assert read_journal(tmp_path) == {}
    again = BatchRow(1, "a", ("/a.png",), FAILED, "Gone.", "0f")
    lines = [GOOD.to_line(), BAD.to_line(), again.to_line(), GOOD.to_line()[:40]]
    (tmp_path / JOURNAL).write_text("\n".join(lines), encoding="utf-8")
    assert read_journal(tmp_path) == {"a": again, "b": BAD}
