"""From where all frames are to a sequence's folder."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

import numpy as np
from scipy.ndimage import affine_transform
from scipy.spatial.transform import Rotation

from facestage import __version__
from facestage.contract.arrays import Float
from facestage.contract.face_model import FaceModel
from facestage.contract.files.partial import KEYFRAME_PICTURES, KEYFRAMES
from facestage.contract.person import Person
from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED, Result
from facestage.contract.result_files import WRINKLES_PICTURE
from facestage.contract.sequence import KEYFRAMES as KEYFRAMES_FOLDER
from facestage.contract.sequence import (
    LIVE_LINK,
    LOST,
    SEEN,
    UNSURE,
    VERTICES,
    Sequence,
    SequenceFrame,
)
from facestage.contract.texture_maps import TEXTURE_MAPS
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.live_link import live_link_csv
from facestage.fit.sequence.motion import GROUP_NAMES
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.sightings import Sightings
from facestage.fit.sequence.skin.changes import SkinChanges
from facestage.fit.sequence.tracking import DOUBT, Tracked, Tracker
from facestage.fit.sequence.wrinkles.wrinkles import FilmWrinkles
from facestage.images.film import Film, Frame
from facestage.images.image_io import write_exr
from facestage.landmarks.tracker import Sight
from facestage.report import (
    ShownFrame,
    blood_picture,
    to_srgb8,
    write_sequence_report,
    write_wrinkles_picture,
)

# Of each light, a pixel: what is looked at for the fit is grainy.
SHOWN_SAMPLES = 4
FILM_MOST = 96  # frames of the report's film
PICTURE_SIDE = 160  # pixels of each of its pictures
HEAD_SIDE = 0.24  # metres that they show
UNSURE_SHARE = 0.3  # of the frames, from which on the sequence is not believed


@dataclass(frozen=True, eq=False)
class Found:
    """Everything that a sequence's folder shows."""

    film: Film
    sightings: Sightings
    keyframes: list[int]  # indices
    person: Person
    keyframe: Result
    model: FaceModel
    tracked: Tracked
    errors: dict[str, float]
    errors_by_landmarks: dict[str, float]  # before pictures were looked at; none after a resume
    timings: dict[str, float]
    in_time: bool
    skin: SkinChanges | None = None  # where it was asked for
    wrinkles: FilmWrinkles | None = None  # the same


def write_sequence(
    folder: Path, request: Request, found: Found, tracker: Tracker, partial: Path
) -> Sequence:
    """Write every file of the sequence into an existing folder."""
    tracked, sightings = found.tracked, found.sightings
    blood = None
    if found.skin is not None and found.skin.haemoglobin.is_clear:
        blood = found.skin.haemoglobin
    wrinkles = found.wrinkles
    deviations = {"pose": tracked.deviation[:, :POSE], "expression": tracked.deviation[:, POSE:]}
    frames = tuple(_frames(found))
    status, advice = _verdict(found, frames)
    track = Sequence(
        status=status,
        advice=advice,
        film=str(found.film.path.absolute()),
        model=request.model,
        camera=tracker.actor.camera,
        frame_rate=found.film.rate,
        frames=frames,
        keyframes=tuple(sightings.numbers[index] for index in found.keyframes),
        identity_names=found.model.identity_names,
        expression_names=found.model.expression_names,
        identity=np.asarray(found.keyframe.identity),
        expression=tracked.course.expression,
        model_to_camera=tracked.course.model_to_camera,
        deviations=deviations if blood is None else deviations | {"haemoglobin": blood.deviation},
        motion=_motion(tracked),
        errors=found.errors,
        timings=found.timings,
        versions=_versions(),
        folder=folder,
        light_radiance=_light_radiance(tracker, tracked),
        haemoglobin=None if blood is None else blood.coefficients,
        haemoglobin_harmonics=None if blood is None else blood.harmonics.astype(np.float32),
        haemoglobin_color=None if blood is None else blood.color,
        skin=_figures(found),
        wrinkles=() if wrinkles is None else tuple(each.wrinkles for each in wrinkles.found),
    )
    track.write_into(folder)
    shutil.copytree(partial / KEYFRAMES, folder / KEYFRAMES_FOLDER)
    if (partial / KEYFRAME_PICTURES).is_dir():
        shutil.copytree(partial / KEYFRAME_PICTURES, folder / KEYFRAMES_FOLDER, dirs_exist_ok=True)
    for each in TEXTURE_MAPS:
        with suppress(FileNotFoundError):
            first = folder / KEYFRAMES_FOLDER / found.person.photos[0].folder
            shutil.copyfile(first / each.file, folder / each.file)
    if wrinkles is not None and wrinkles.found:
        _write_wrinkles(folder, wrinkles)
    write_live_link(folder, track)
    if request.with_vertices:
        write_vertices(folder / VERTICES, tracker.actor, tracked.course)
    wanted = some_of(0, len(sightings) - 1)
    shown = (frame for frame in found.film.frames() if frame.index in wanted)
    write_sequence_report(folder, track, list(shown_frames(shown, tracker, tracked, track)))
    return track


def _figures(found: Found) -> dict[str, float]:
    """Of skin that changes."""
    skin = {} if found.skin is None else found.skin.figures
    return skin if found.wrinkles is None else skin | found.wrinkles.figures


def _write_wrinkles(folder: Path, wrinkles: FilmWrinkles) -> None:
    """Their maps, and a picture of them."""
    heights = {each.wrinkles.name: each.height for each in wrinkles.found}
    for each in wrinkles.found:
        write_exr(folder / each.wrinkles.height_file, each.height)
        write_exr(folder / each.wrinkles.normal_file, each.normal)
    write_wrinkles_picture(folder / WRINKLES_PICTURE, heights, wrinkles.texel_mm)


def _light_radiance(tracker: Tracker, tracked: Tracked) -> np.ndarray | None:
    if tracked.lights is None:
        return None
    return np.array([tracker.actor.forward.lights.radiance(one) for one in tracked.lights])


def _frames(found: Found) -> Iterator[SequenceFrame]:
    tracked, sightings, shots = found.tracked, found.sightings, found.sightings.shots
    doubts = tracked.doubts
    for index, number in enumerate(sightings.numbers):
        sight, doubt = sightings.sights[index], doubts[index]
        status, advice = SEEN, ""
        if sight == Sight.LOST:
            status = LOST
            advice = "No face was found; pose and expression follow the frames beside it."
        elif np.isfinite(doubt) and doubt > DOUBT:
            status = UNSURE
            advice = (
                f"Explained {doubt:.1f} times worse than most frames: blurred, covered, or another "
                "face; it follows the frames beside it more."
            )
        elif sight == Sight.CUT:
            status, advice = UNSURE, "The picture jumps here: a cut, or another face."
        elif sight == Sight.FOUND and index:
            advice = "The face was lost, and found again here."
        yield SequenceFrame(
            number,
            float(sightings.times[index]),
            sightings.names[index],
            status,
            advice,
            int(shots[index]),
            _plain(tracked.photo_rms[index]),
            _plain(tracked.landmark_rms[index]),
        )


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _verdict(found: Found, frames: tuple[SequenceFrame, ...]) -> tuple[str, str]:
    """The sequence's status, and a sentence."""
    unsure = sum(frame.status != SEEN for frame in frames)
    shots = max(frame.shot for frame in frames)
    parts = [f"{len(frames)} frames follow one face"]
    if unsure:
        parts.append(f"{unsure} of them need a look")
    if shots > 1:
        parts.append(f"there are {shots} shots, between which nothing is smoothed")
    if found.tracked.lights is not None:
        parts.append("their light changes, and was followed")
    if found.skin is not None:
        parts.append(found.skin.words)
    if found.wrinkles is not None:
        parts.append(found.wrinkles.words)
    if not found.in_time:
        return BUDGET_SPENT, "The time ended first: " + ", ".join(parts) + "."
    if found.person.status == STOPPED:
        return STOPPED, ", ".join(parts) + "; of the keyframes: " + found.person.advice
    if unsure > UNSURE_SHARE * len(frames):
        return STOPPED, ", ".join(parts) + "; track the part of the film that shows the face well."
    return CONVERGED, ", ".join(parts) + "."


def _motion(tracked: Tracked) -> dict[str, float]:
    """The learned scales, the root mean square of each group."""
    motion = tracked.motion
    return {
        name: float(np.sqrt((motion.scales[motion.groups == group] ** 2).mean()))
        for group, name in enumerate(GROUP_NAMES)
        if (motion.groups == group).any()
    }


def write_vertices(path: Path, actor: Actor, course: Course) -> None:
    """Every vertex of the model in every frame, (F, n, 3) float32, frame by frame."""
    model = actor.geometry.model
    shape = (len(course), len(model.vertices), 3)
    with path.open("wb") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(stream, header)
        for index in range(len(course)):
            vertices = model.shape(None, course.expression[index]) @ course.rotation[index].T
            vertices += course.translation[index]
            stream.write(np.ascontiguousarray(vertices, "<f4").tobytes())


def write_live_link(folder: Path, track: Sequence) -> None:
    """What Live Link Face would have recorded, where the model's expressions are ARKit's."""
    csv = live_link_csv(
        track.expression_names,
        track.expression,
        track.frames,
        Rotation.from_matrix(track.model_to_camera[:, :3, :3]).as_euler("YXZ"),
        track.frame_rate,
    )
    if csv is not None:
        (folder / LIVE_LINK).write_text(csv, encoding="utf-8", newline="")


def some_of(first: int, last: int) -> set[int]:
    """FILM_MOST indices at most, from ``first`` to ``last``."""
    count = min(FILM_MOST, last - first + 1)
    return set(np.linspace(first, last, count).round().astype(int).tolist())


def shown_frames(
    frames: Iterable[Frame], tracker: Tracker, tracked: Tracked, track: Sequence
) -> Iterator[ShownFrame]:
    """``frames`` beside their fits, cut to where the head is; all of one person are as large."""
    places = {frame.number: place for place, frame in enumerate(track.frames)}
    for frame in frames:
        view = tracker.view(frame)
        if view is None:
            continue
        view = replace(view, term=replace(view.term, samples=SHOWN_SAMPLES))
        state = tracked.state(tracker.actor, frame.index)
        photo = view.term.photo.color
        evaluation = view.evaluated(state)
        used = evaluation.base_weight > 0
        fit = photo + np.where(used[..., None], evaluation.residual, 0.0)
        camera = view.window.camera(state.camera)
        (centre,) = camera.project(state.translation[None])
        step = HEAD_SIDE * camera.focal_px / -float(state.translation[2]) / PICTURE_SIDE
        first = centre[::-1] - 0.5 + (0.5 - PICTURE_SIDE / 2) * step
        linear = [photo, fit]
        if track.haemoglobin is not None and track.haemoglobin_harmonics is not None:
            own = track.haemoglobin[places[frame.number]] @ track.haemoglobin_harmonics
            surface = evaluation.image.surface
            corners = own[tracker.actor.geometry.used][surface.corners]
            blood = np.zeros(photo.shape[:2])
            blood[view.term.index(surface)] = (corners * surface.weights).sum(axis=1)
            linear.append(blood_picture(photo, blood))
        pictures = (to_srgb8(_cut(each, step, first)) for each in linear)
        yield ShownFrame(frame.number, frame.time, *pictures)


def _cut(
    linear: Float[np.ndarray, "height width 3"], step: float, first: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, "side side 3"]:
    """The pixels from ``first`` (row, column) on, ``step`` apart; black beyond the picture."""
    shape = PICTURE_SIDE, PICTURE_SIDE
    channels = [
        affine_transform(linear[..., channel], (step, step), first, shape, order=1)
        for channel in range(3)
    ]
    return np.stack(channels, axis=-1)


def _versions() -> dict[str, str]:
    names = ("mitsuba", "drjit", "numpy", "scipy")
    return {"facestage": __version__, "python": platform.python_version()} | {
        name: metadata.version(name) for name in names
    }
