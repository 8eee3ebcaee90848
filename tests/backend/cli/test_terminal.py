"""A fit as a person at a terminal sees it."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

from facestage.cli.terminal import ProgressLine, listener, summary
from facestage.contract.events import Event
from facestage.contract.result import Result
from reference.command_line import Finished


class Terminal(io.StringIO):
    """A stream that somebody looks at; ``screen`` is what stands there."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True

    @property
    def screen(self) -> list[str]:
        lines = []
        for line in self.getvalue().split("\n"):
            shown = ""
            for part in line.split("\r"):
                shown = part + shown[len(part) :]
            lines.append(shown.rstrip())
        return lines


def step(fraction: float, words: str = "Fitting: joint, step 3") -> Event:
    return Event("progress", "joint", 3, 0.0123, 5.0, 7.4, fraction, message=words)


def test_events_are_drawn_over_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    terminal = Terminal()
    line = ProgressLine(terminal)
    line(step(0.5, "Fitting with many words that are taken away again"))
    line(step(0.75))
    (shown,) = terminal.screen
    assert (
        shown == "█" * 18 + "░" * 6 + "  75%  Fitting: joint, step 3  photo error 0.0123  7 s left"
    )
    line.close()
    terminal.write("facestage: cancelled")
    assert terminal.screen == ["facestage: cancelled"]


def test_the_line_is_no_wider_than_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    terminal = Terminal()
    line = ProgressLine(terminal)
    for fraction in (-1.0, 0.2, 7.0):
        line(step(fraction, "words " * 50))
        (shown,) = terminal.screen
        assert 30 < len(shown) <= 39


def test_a_terminal_without_blocks_gets_letters() -> None:
    terminal = Terminal()
    terminal.encoding = "ascii"
    ProgressLine(terminal)(step(0.5))
    terminal.getvalue().encode("ascii")
    assert terminal.screen[0].startswith("############............  50%")


def test_programs_get_json_and_people_who_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream, as_json, expected in (
        (io.StringIO(), False, True),
        (Terminal(), True, True),
        (Terminal(), False, False),
    ):
        monkeypatch.setattr(sys, "stdout", stream)
        with listener(as_json) as emit:
            emit(step(0.25))
        found = stream.getvalue().splitlines()
        assert (Event.from_line(found[0]) == step(0.25)) == expected


def test_the_last_words_say_how_good_it_is_and_where(finished: Finished) -> None:
    out, _ = finished
    words = summary(out)
    result = Result.load(out)
    assert " ".join(words.split("\n\n")[0].split()) == result.advice
    assert f"{result.errors['psnr_skin']:.4g} dB" in words
    assert f"Report: {out / 'report.html'}" in words
    assert (out / "report.html").is_file()
    assert max(map(len, words.splitlines())) <= 100 + len(str(out))


def test_the_last_words_of_several_photos_name_each(tmp_path: Path) -> None:
    photo = {
        "number": 1,
        "image": "/photos/a b.png",
        "folder": "1",
        "status": "converged",
        "advice": "Good.",
        "shares_shape": True,
        "errors": {"psnr_skin": 31.5},
    }
    person = {
        "schema": 1,
        "status": "converged",
        "advice": "Two photos of one person.",
        "model": "default",
        "photos": [photo, {**photo, "number": 2, "image": "b.png", "errors": {}}],
        "identity": [0.0],
        "albedo": [0.0],
        "specular": [[1.0]],
        "roughness": 0.4,
        "timings": {},
    }
    (tmp_path / "person.json").write_text(json.dumps(person), encoding="utf-8")
    words = summary(tmp_path)
    assert words.startswith("Two photos of one person.\n\nPhoto 1, a b.png: converged\n  31.5 dB")
    assert "Photo 2, b.png: converged" in words
    assert words.endswith(f"Report: {tmp_path / 'person.html'}")
