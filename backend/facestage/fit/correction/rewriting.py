"""A sequence written anew where it was fitted again; all else stays as it was."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract import sequence as contract
from facestage.contract.result_files import is_result_file
from facestage.fit.correction.keyed import Keyed
from facestage.fit.correction.span import Span
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.output import write_live_link, write_vertices
from facestage.fit.sequence.smoother import Evidence
from facestage.fit.sequence.tracking import Tracked, honest
from facestage.report import ShownFrame, write_sequence_report

AGAIN = " Fitted again around "  # what a sequence's advice says from then on
BY_HAND = "Corrected by hand."


def course_of(track: contract.Sequence) -> Course:
    """Where a sequence has its frames."""
    poses = track.model_to_camera
    return Course(poses[:, :3, :3], poses[:, :3, 3], track.expression)


def put_together(
    track: contract.Sequence,
    span: Span,
    keyed: Keyed,
    tracked: Tracked,
    said: Evidence,
    timings: Mapping[str, float],
) -> contract.Sequence:
    """The whole sequence with the range of ``span`` as it is now: ``keyed`` and ``tracked``, by
    what its frames have ``said``. ``timings`` of the refit, in seconds.
    """
    indices, free = span.indices[span.free], span.free
    expression, poses = track.expression.copy(), track.model_to_camera.copy()
    expression[indices] = keyed.course.expression[free]
    poses[indices] = keyed.course.model_to_camera[free]
    frames = list(track.frames)
    corrected = {each.frame for each in span.corrections}
    for index, inside in zip(indices, np.flatnonzero(free), strict=True):
        changes: dict[str, object] = {}
        if frames[index].number in corrected:
            changes |= {"status": contract.SEEN, "advice": BY_HAND}
        for name in ("photo_rms", "landmark_rms"):
            value = float(getattr(tracked, name)[inside])
            changes[name] = value if np.isfinite(value) else None
        frames[index] = replace(frames[index], **changes)  # type: ignore[arg-type]
    told = track.advice.split(AGAIN)[0]
    count = len(span.corrections)
    told += f"{AGAIN}{count} frame{'s' * (count > 1)} corrected by hand."
    return replace(
        track,
        advice=told,
        expression=expression,
        model_to_camera=poses,
        deviations=_deviations(track, span, keyed, said),
        frames=tuple(frames),
        corrected=span.corrections,
        timings={**track.timings, **timings},
    )


def _deviations(
    track: contract.Sequence, span: Span, keyed: Keyed, said: Evidence
) -> dict[str, np.ndarray]:
    """Nowhere more than they were: keys are known besides."""
    result = dict(track.deviations)
    assert keyed.deviation is not None
    found = honest(keyed.deviation, said.hessian)
    for name, columns in (("pose", slice(0, POSE)), ("expression", slice(POSE, None))):
        if name in result:
            values = result[name].copy()
            own = span.indices[span.free]
            values[own] = np.minimum(values[own], found[span.free, columns])
            result[name] = values
    return result


def write_again(
    folder: Path, track: contract.Sequence, actor: Actor, shown: Sequence[ShownFrame]
) -> None:
    """Write every file of the sequence into an existing folder, those that stay from where it was
    read; of its pictures, those of the frames that are ``shown``.
    """
    before = Path(str(track.folder))
    for path in before.rglob("*"):
        own = path.relative_to(before)
        if path.is_file() and is_result_file(own):
            (folder / own).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, folder / own)
    track.write_into(folder)
    write_live_link(folder, track)
    if (folder / contract.VERTICES).is_file():
        write_vertices(folder / contract.VERTICES, actor, course_of(track))
    write_sequence_report(folder, track, list(shown))
