"""What a fit left out, in sentences for the result: what, why, how much of it, and what that saved
in this run.
"""

from __future__ import annotations

from typing import Any

from facestage.contract.face_model import OTHER
from facestage.contract.job import LEAN
from facestage.contract.light_stage import OFF
from facestage.fit.energy.plan import Ledger
from facestage.fit.energy.shadow_edges import omission
from facestage.fit.given.problem import FINE_FACE_PX, Problem
from facestage.fit.trust.fitted import Fitted

# Kinds of work in the ledger, in words.
UNITS = {
    "samples": "light samples",
    "rays": "shadow rays",
    "lit": "pixels lit",
    "cells": "entries of the Jacobian",
    "lines": "scan lines on the lights",
}


def left_out(problem: Problem, fitted: Fitted) -> list[dict[str, Any]]:
    """One entry per omission: ``what``, ``why``, ``saved`` (a sentence), and ``seconds`` where this
    run can tell.

    Seconds are the units that were left out at the rate at which this run did the same kind of
    work.
    """
    entries: list[dict[str, Any]] = []

    def add(what: str, why: str, saved: str, seconds: float | None = None) -> None:
        entry: dict[str, Any] = {"what": what, "why": why, "saved": saved}
        if seconds is not None:
            entry["seconds"] = seconds
        entries.append(entry)

    if problem.job.plan == LEAN:
        _measured(problem, fitted, add)
    else:
        add(
            "nothing that the plan knows of",
            "the job asks for the full plan",
            "nothing: every rule was off",
        )
    _behind(problem, fitted, add)
    if fitted.dark.any():
        add(
            f"{amount(int(fitted.dark.sum()))} dark pixels of the face",
            "the light on the rest cannot leave them so dark: a shadow of something, hair, a beard",
            "no time: they would have bent light and shape",
        )
    if ("shadows", "lines") in fitted.ledger.skipped:
        what, why = omission(fitted.penumbra)
        add(what, why, *saved_sentence(fitted.ledger, "shadows", "lines"))
    _structural(problem, add)
    return entries


def saved_sentence(ledger: Ledger, rule: str, kind: str) -> tuple[str, float | None]:
    """Such as "4.1 million shadow rays, about 1.3 s at this run's 3.2 million a second", and the
    seconds.
    """
    units, seconds = ledger.saved(rule).get(kind, (0.0, None))
    words = f"{amount(units)} {UNITS[kind]}"
    rate = ledger.rate(kind)
    if seconds is None or rate is None:
        return f"{words}; not timed, this run never did any", None
    return f"{words}, about {seconds:.2g} s at this run's {amount(rate)} a second", seconds


def amount(count: float) -> str:
    """A count in words: 431, 27 thousand, 4.1 million."""
    for size, name in ((1e9, "billion"), (1e6, "million"), (1e3, "thousand")):
        if count >= size:
            return (
                f"{count / size:.2g} {name}" if count < 100 * size else f"{count / size:.0f} {name}"
            )
    return f"{count:.0f}"


def _measured(problem: Problem, fitted: Fitted, add: Any) -> None:
    """What the rules of the plan left out while fitting."""
    ledger = fitted.ledger
    off = int((problem.stage.state == OFF).sum())
    if off:
        # They would have been traced with the others, at the same cost each.
        share = off / max(int(problem.lit.sum()), 1)
        work = ledger.work.get("samples")
        add(
            f"{off} of {len(problem.stage)} lights",
            "switched off",
            "never traced"
            if work is None
            else f"{amount(share * work.units)} light samples, about "
            f"{share * work.seconds:.2g} s at this run's {amount(ledger.rate('samples') or 0)} "
            "a second",
            None if work is None else share * work.seconds,
        )
    reasons = {
        ("pixels", "lit"): (
            "pixels without weight",
            "seen too obliquely, beside another part, or not of the skin's color",
        ),
        ("lights", "samples"): (
            "lights that were fitted to zero",
            "they want to stay dark, and are asked again every few steps",
        ),
        ("columns", "cells"): (
            "columns of the Jacobian",
            "frozen parameters, and modes that move nothing that the photo shows",
        ),
    }
    for (rule, kind), (what, why) in reasons.items():
        if (rule, kind) in ledger.skipped:
            add(what, why, *saved_sentence(ledger, rule, kind))
    facing = ledger.skipped.get(("facing", "rays"))
    if facing:
        add(
            "shadow rays towards lights behind a surface",
            "n.l <= 0: no light, no ray",
            f"{amount(facing)} shadow rays",
        )
    dark = int((fitted.stage.radiance.max(axis=1) <= 0).sum())
    if dark > 0:
        add(f"{dark} lights in the final picture", "fitted to exactly zero", "no radiance to add")
    for name in problem.job.freeze:
        add(name, "frozen by the job", "its columns of the Jacobian")
    if problem.job.camera is not None:
        add("focal length", "the camera is known", "one column of the Jacobian")
    if not fitted.state.specular.any():
        add("highlights", "the specular map is zero", "the specular terms of every light sample")
    if fitted.state.interreflection == 0 and "interreflection" not in problem.job.freeze:
        shown = fitted.between
        add(
            "light from skin to skin",
            "the photo shows none of it" if shown is None or shown.joined else shown.words,
            "its rays, and one column of the Jacobian",
        )
    if fitted.state.translucency == 0 and "translucency" not in problem.job.freeze:
        add(
            "light that comes out of the skin unevenly",
            "the photo shows none of it",
            "one column of the Jacobian",
        )
    if fitted.below is not None and not fitted.below.joined:
        add("light below the skin", fitted.below.words, "its sums, and a column of the Jacobian")
    if problem.lights.uniform:
        add(
            "two of three light channels",
            "one color for all lights",
            "two of three columns of every light",
        )


def _behind(problem: Problem, fitted: Fitted, add: Any) -> None:
    """Lights behind the face, where they were looked for."""
    found, work = fitted.surround, fitted.ledger.work.get("samples")
    if found is None or found.joined:
        return
    share, rate = len(found.lights) / max(int(problem.lit.sum()), 1), fitted.ledger.rate("samples")
    if work is None or rate is None:
        add(f"{len(found.lights)} lights behind the face", found.words, "never traced")
        return
    units, seconds = share * work.units, share * work.seconds
    pace = f"about {seconds:.2g} s at this run's {amount(rate)} a second"
    saved = f"{amount(units)} light samples, {pace}"
    add(f"{len(found.lights)} lights behind the face", found.words, saved, seconds)


def _structural(problem: Problem, add: Any) -> None:
    """What no plan brings back: it is not part of the method."""
    factor = problem.scale(FINE_FACE_PX)
    if factor < 1:
        add(
            f"photo resolution beyond a face of {FINE_FACE_PX:.0f} px",
            "it adds texture, not shape",
            f"a factor of {1 / factor**2:.1f} in pixels while fitting",
        )
    hidden = int((problem.geometry.model.triangle_part == OTHER).sum())
    if hidden:
        add(
            "see-through shells of the model (tear film, lashes)",
            "no opaque surface",
            f"{hidden} triangles",
        )
    add(
        "gradient of contours within the face",
        "their pixels are down-weighted; outline and landmarks hold the shape",
        "boundary sampling in every step",
    )
