"""What a bench says over all its cases."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from facestage.bench.summary import measured_qualities, summary_lines, tone_lines, write_qualities
from facestage.bench.table import Final
from facestage.contract.quality import BEST, DRAFT, GOOD, Expectation


def run(case: str, contender: str, seconds: float, start: float, end: float, psnr: float) -> Final:
    return Final(
        case, "ours", contender, seconds, end, end, psnr, psnr, 0.03, 0.05, start, seconds + 1
    )


FINALS = [
    run("a", "Facestage", 9.0, 2.0, 0.8, 40.0),
    run("a", "draft", 3.0, 2.0, 1.2, 35.0),
    run("a", "best", 29.0, 2.0, 0.7, 41.0),
    run("b", "Facestage", 11.0, 1.0, 1.1, 30.0),
    run("b", "draft", 5.0, 1.0, 1.0, 29.0),
    run("b", "best", 39.0, 1.0, 1.0, 31.0),
]


def test_medians_over_the_cases():
    found = measured_qualities(FINALS)
    assert found[DRAFT] == {"seconds": 5.0, "similarity_mm": 1.1, "psnr": 32.0}
    assert found[GOOD] == {"seconds": 11.0, "similarity_mm": 0.95, "psnr": 35.0}
    assert found[BEST]["seconds"] == 35.0


def test_a_case_that_ended_behind_its_start_is_named():
    text = "\n".join(summary_lines(FINALS))
    assert "2 cases" in text and "1.50 mm" in text and "0.95 mm" in text
    assert "Further from the truth than their own landmark stage: b." in text
    assert "No case ended further" in "\n".join(summary_lines(FINALS[:3]))
    assert summary_lines([]) == []


def test_the_file_has_the_form_that_the_contract_reads(tmp_path: Path):
    write_qualities(tmp_path, FINALS, "two cores")
    data = json.loads((tmp_path / "quality.json").read_text(encoding="utf-8"))
    assert data["cases"] == ["a", "b"]
    assert Expectation(**data["qualities"][GOOD]).seconds == 11.0


def test_skin_tone_is_told_by_type_with_its_bias() -> None:
    angles = ((-40.0, -35.0), (-20.0, -45.0), (50.0, 45.0), (30.0, 35.0))
    toned = [
        replace(FINALS[0], ita=found, true_ita=true, chromaticity=0.01 * (number + 1))
        for number, (found, true) in enumerate(angles)
    ]
    first, light, intermediate, dark = tone_lines([*toned, FINALS[0]])
    assert "4 cases" in first and "off by 10.0 degrees on average, bias +5.0" in first
    assert "largest bias of a skin type 10.0" in first and "0.025 in the median" in first
    assert light.startswith("Skin type light (1): off by 5.0") and "bias +5.0" in light
    assert intermediate.startswith("Skin type intermediate (1)") and "bias -5.0" in intermediate
    assert dark.startswith("Skin type dark (2): off by 15.0") and "bias +10.0" in dark
    assert tone_lines(FINALS) == []
