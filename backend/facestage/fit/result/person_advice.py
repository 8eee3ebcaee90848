"""What is said of several photos of one person: of each beside the others, and of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.person import PersonPhoto
from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED
from facestage.fit.runs.joint_run import JointFitted
from facestage.fit.runs.member import Member
from facestage.fit.trust.same_person import Difference


def company(member: Member, fitted: JointFitted, shape_held: bool) -> str:
    """What speaks against a photo beside the others."""
    difference = fitted.odd.get(member.number - 1)
    if difference is not None:
        return (
            f"This photo may show another person than the others: {_distance(difference)}."
            f"{' It is left out of the shape that they share.' if member.stranger else ''} "
            "Check who is on it and its "
            "landmarks."
        )
    if member.doubt and not shape_held:
        return (
            "This photo is left out of the shape that the others share, because "
            f"{member.doubt}; check its landmarks, "
            "and mask what is not the face with an alpha channel."
        )
    return ""


def _distance(difference: Difference) -> str:
    # Beyond a million nobody counts.
    times = min(np.exp(-difference.nats), 1e6)
    return f"its landmarks are {times:,.0f} times likelier of another face than of the others'"


def person_verdict(photos: Sequence[PersonPhoto], fitted: JointFitted) -> tuple[str, str]:
    """Status and advice for all photos together."""
    statuses = {photo.status for photo in photos}
    if BUDGET_SPENT in statuses:
        return BUDGET_SPENT, next(photo.advice for photo in photos if photo.status == BUDGET_SPENT)
    odd = sorted(fitted.odd)
    if len(photos) == len(odd) == 2:
        return STOPPED, (
            f"Photos 1 and 2 may show different people: {_distance(fitted.odd[0])}. Check who "
            "is on them and their "
            "landmarks, or fit them one by one."
        )
    if odd:
        which = photos[odd[0]]
        return STOPPED, f"Photo {which.number} ({Path(which.image).name}): {which.advice}"
    against = next((photo for photo in photos if photo.status == STOPPED), None)
    if against is not None:
        return STOPPED, f"Photo {against.number} ({Path(against.image).name}): {against.advice}"
    psnr = [photo.errors["psnr_skin"] for photo in photos if "psnr_skin" in photo.errors]
    return CONVERGED, (
        f"Converged: {len(photos)} photos share one shape and one skin, which explain them "
        "with a PSNR of "
        f"{min(psnr):.1f} to {max(psnr):.1f} dB."
    )
