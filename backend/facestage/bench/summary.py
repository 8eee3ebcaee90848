"""What a bench says of the fit as a whole: what each quality buys, and whether any case ended
behind its start.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from facestage.bench.settings import DEFAULT
from facestage.bench.table import Final
from facestage.contract.files.atomic import atomic_file
from facestage.contract.quality import BEST, DRAFT, GOOD
from facestage.contract.skin_tone import SKIN_TYPES, skin_type

QUALITY_JSON = "quality.json"
CONTENDERS = {DRAFT: DRAFT, GOOD: DEFAULT.name, BEST: BEST}


def measured_qualities(finals: Sequence[Final]) -> dict[str, dict[str, float]]:
    """Medians over the cases by quality: seconds up to the albedo detail, mm, dB."""
    result = {}
    for quality, contender in CONTENDERS.items():
        runs = [
            item for item in finals if item.contender == contender and item.detail_psnr is not None
        ]
        if runs:
            result[quality] = {
                "seconds": round(statistics.median(item.total_seconds for item in runs), 2),
                "similarity_mm": round(statistics.median(item.similarity_mm for item in runs), 3),
                "psnr": round(statistics.median(item.detail_psnr or 0.0 for item in runs), 2),
            }
    return result


def write_qualities(folder: Path, finals: Sequence[Final], machine: str) -> None:
    """Write what the quality names buy into ``folder``, in the form of contract/quality.json."""
    cases = list(dict.fromkeys(item.case for item in finals))
    data: dict[str, Any] = {
        "cases": cases,
        "machine": machine,
        "qualities": measured_qualities(finals),
    }
    with atomic_file(folder / QUALITY_JSON) as temporary:
        temporary.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def summary_lines(finals: Sequence[Final]) -> list[str]:
    """Sentences about the default fit over all cases."""
    runs = [item for item in finals if item.contender == DEFAULT.name and item.start_mm is not None]
    if not runs:
        return []
    starts, ends = [item.start_mm or 0.0 for item in runs], [item.similarity_mm for item in runs]
    behind = [item.case for item in runs if item.similarity_mm > (item.start_mm or 0.0)]
    ahead = "No case ended further from the truth than its own landmark stage."
    average = (
        f"Facestage on {len(runs)} cases: landmarks alone {statistics.mean(starts):.2f} mm on "
        f"average, the fit {statistics.mean(ends):.2f} mm (median {statistics.median(ends):.2f}, "
        f"worst {max(ends):.2f})."
    )
    worse = f"Further from the truth than their own landmark stage: {', '.join(behind)}."
    lines = [average, worse if behind else ahead]
    lines += [
        f"Scan {item.case}: the points that the mesh covers {item.start_covered_mm or 0.0:.2f} mm "
        f"by landmarks, {item.covered_mm:.2f} mm by the fit; {item.within_1 or 0.0:.0%} of all "
        f"within one of the fit's own deviations, {item.within_2 or 0.0:.0%} within two."
        for item in runs
        if item.covered_mm is not None
    ]
    lines += tone_lines(runs)
    for quality, found in measured_qualities(finals).items():
        lines.append(
            f"Quality {quality}: {found['seconds']:.1f} s, {found['similarity_mm']:.2f} mm, "
            f"{found['psnr']:.1f} dB (medians over the cases)."
        )
    return lines


def tone_lines(finals: Sequence[Final]) -> list[str]:
    """Sentences about skin tone where the true albedo is known, as Feng et al. 2022 (TRUST) report
    it: the angle's error, and by skin type whether people end too light or too dark.
    """
    known = [
        (item.ita, item.true_ita, item.chromaticity)
        for item in finals
        if item.ita is not None and item.true_ita is not None and item.chromaticity is not None
    ]
    if not known:
        return []
    found, true, shares = (np.array(column) for column in zip(*known, strict=True))
    error, kinds = found - true, [skin_type(angle) for angle in true]
    by_type = {
        name: error[[kind == name for kind in kinds]] for name, _ in SKIN_TYPES if name in kinds
    }
    biases = {name: float(errors.mean()) for name, errors in by_type.items()}
    overall = (
        f"Skin tone of {len(known)} cases: individual typology angle off by "
        f"{np.abs(error).mean():.1f} degrees on average, bias {error.mean():+.1f}, largest bias of "
        f"a skin type {max(map(abs, biases.values())):.1f}; chromaticity off by "
        f"{np.median(shares):.3f} in the median, {np.percentile(shares, 90):.3f} in the worst "
        "tenth."
    )
    return [
        overall,
        *(
            f"Skin type {name} ({len(errors)}): off by {np.abs(errors).mean():.1f} degrees on "
            f"average, bias {biases[name]:+.1f} (more is lighter)."
            for name, errors in by_type.items()
        ),
    ]
