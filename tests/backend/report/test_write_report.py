from __future__ import annotations

import base64
import io
import re
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from backend.report.example import report_data
from facestage.report import ReportData, write_report

PICTURES = {
    "albedo.png",
    "comparison.png",
    "face.png",
    "face_photo.png",
    "landmarks.png",
    "light_probe.png",
    "roughness.png",
    "specular.png",
    "texture_coverage.png",
    "trace.png",
    "weights.png",
}


class Page(HTMLParser):
    """Collects what a browser would load, and checks that tags are closed in order."""

    VOID = frozenset({"meta", "img", "input", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [
            value or "" for name, value in attrs if name in ("src", "srcset", "href", "data")
        ]
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open[-1:] != ["style"]:
            self.text += f"{data} "


def write(folder: Path, data: ReportData) -> Page:
    write_report(folder, data)
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def assert_pictures_decode(folder: Path) -> None:
    for path in folder.glob("*.png"):
        with Image.open(path) as image:
            image.load()
            assert image.format == "PNG" and min(image.size) >= 1 and max(image.size) <= 1600, (
                path.name
            )


def test_a_report_holds_every_picture_and_number(tmp_path: Path) -> None:
    page = write(tmp_path, report_data())
    assert {path.name for path in tmp_path.iterdir()} == PICTURES | {
        "relit_from_left.png",
        "report.html",
    }
    assert_pictures_decode(tmp_path)
    for expected in (
        "Ada & friends",
        "Converged",
        "It converged <well>.",
        "33.17",
        "1.294",
        "1.876",
        "81.25",
        "12.25",
        "90817",
        "1.2.3",
        "0.432",
        "7 of 20 lights",
        "switched off",
        "facestage fit --job . --out ../again",
        "Face model: Head, made for tests. Licence: CC0 & free.",
    ):
        assert expected in page.text, expected


def test_the_page_needs_no_other_file_and_no_network(tmp_path: Path) -> None:
    page = write(tmp_path, report_data())
    assert len(page.sources) == len(PICTURES) + 1
    for source in page.sources:
        kind, _, content = source.partition(";base64,")
        assert kind in ("data:image/png", "data:image/jpeg")
        with Image.open(io.BytesIO(base64.b64decode(content, validate=True))) as image:
            image.load()
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not re.search(
        r"https?:|//[a-z]|@import|url\(", re.sub(r"base64,[A-Za-z0-9+/=]+", "", text)
    )


def test_hostile_names_do_not_become_markup(tmp_path: Path) -> None:
    data = report_data(title="<script>alert(1)</script>", relit={"../<b>": np.zeros((48, 40, 3))})
    page = write(tmp_path, data)
    assert "<script>alert(1)</script>" in page.text
    assert (tmp_path / "relit_____b_.png").is_file()
    assert "<script" not in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("status", ["converged", "budget_spent", "stopped"])
def test_each_status_is_named(tmp_path: Path, status: str) -> None:
    data = report_data()
    page = write(tmp_path, replace(data, result=replace(data.result, status=status)))
    name = {
        "converged": "Converged",
        "budget_spent": "Time budget spent",
        "stopped": "Stopped with advice",
    }[status]
    assert page.text.count(name) == 1


def test_without_truth_no_truth_is_shown(tmp_path: Path) -> None:
    data = report_data()
    assert "known truth" in write(tmp_path, data).text
    plain = replace(data, result=replace(data.result, errors={"psnr": 33.17}))
    assert "known truth" not in write(tmp_path, plain).text


def bare() -> dict[str, Any]:
    data = report_data()
    empty: dict[str, Any] = {
        "energy": {},
        "errors": {},
        "timings": {},
        "left_out": [],
        "versions": {},
    }
    zero: dict[str, Any] = {
        "identity": np.zeros(3),
        "expression": np.zeros(0),
        "expression_names": (),
    }
    return {
        "trace": [],
        "relit": {},
        "texture_coverage": None,
        "maps": {name: data.maps[name] for name in ("albedo", "specular")},
        "coverage": np.zeros((48, 40), bool),
        "result": replace(data.result, **empty, **zero),
        "visible": np.zeros(68, bool),
    }


def broken() -> dict[str, Any]:
    data = report_data()
    photo, render, probe = data.photo.copy(), data.render.copy(), data.light_probe.copy()
    photo[:20], render[10:30], probe[0] = np.nan, np.inf, np.inf
    rows = [
        dict(row) | {"photo_rms": float("nan"), "psnr": float("inf"), "seconds": 0.0}
        for row in data.trace
    ]
    return {
        "photo": photo,
        "render": render,
        "light_probe": probe,
        "trace": rows,
        "landmarks": np.full((68, 2), np.nan),
        "maps": {
            "albedo": np.full((16, 16, 3), np.nan),
            "specular": np.full((4, 4), np.nan),
            "roughness": np.full((4, 4), np.inf),
        },
    }


CASES: dict[str, dict[str, Any]] = {
    "one pixel": {"size": (1, 1)},
    "a wide strip": {"size": (4, 900)},
    "a tall strip": {"size": (900, 4)},
    "one light": {"lights": 1},
    "a hundred lights": {"lights": 100},
    "nothing recorded": bare(),
    "values that are not finite": broken(),
    "one step": {"trace": [{"seconds": 0.0, "stage": "joint", "photo_rms": 0.1, "psnr": 20.0}]},
    "dark": {
        "light_probe": np.zeros((8, 16, 3)),
        "photo": np.zeros((48, 40, 3)),
        "render": np.zeros((48, 40, 3)),
    },
}


@pytest.mark.parametrize("case", CASES)
def test_extreme_data_still_gives_a_whole_report(tmp_path: Path, case: str) -> None:
    changes = CASES[case]
    page = write(tmp_path, report_data(**changes))
    assert_pictures_decode(tmp_path)
    bare = case == "nothing recorded"
    unknown = {"roughness.png", "texture_coverage.png"} if bare else set()
    assert {path.name for path in tmp_path.iterdir()} >= PICTURES - unknown | {"report.html"}
    assert not re.search(r"\bnan\b|\binf\b|\bNone\b", page.text)


def test_huge_photos_are_shrunk(tmp_path: Path) -> None:
    shape = (1500, 2600)
    photo = np.full((*shape, 3), 0.5, np.float32)
    write(
        tmp_path,
        report_data(size=shape, photo=photo, render=photo, coverage=np.ones(shape, bool), relit={}),
    )
    with Image.open(tmp_path / "face.png") as image:
        assert image.size == (1024, 591)


def test_importing_the_report_does_not_import_the_plotting() -> None:
    heavy = "('matplotlib', 'PIL', 'skimage', 'mitsuba')"
    code = f"import sys, facestage.report; print([name for name in {heavy} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
