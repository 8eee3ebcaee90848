"""From the end of the schedule to a result folder: texture detail, pictures, numbers."""

from __future__ import annotations

import json
import platform
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from facestage import __version__
from facestage.contract.certainty import DEVIATION, FACE
from facestage.contract.face_model import EYES, OTHER
from facestage.contract.files.storage import finite, write_json
from facestage.contract.light_stage import LIGHT_ARRAYS, LightStage
from facestage.contract.parameters import as_fields
from facestage.contract.relight_cache import relight_fingerprint
from facestage.contract.result import COVERAGE, LIGHT_PROBE, RELIEF, RENDER, Result
from facestage.contract.result_files import LANDMARKS, TRACE
from facestage.contract.texture_maps import EYE_MAP, FOLD_MAP, TEXTURE_MAPS
from facestage.fit.energy.landmark_term import landmark_pixels
from facestage.fit.energy.terms import words_of_energies
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import kept
from facestage.fit.forward.one_light import relight_scale
from facestage.fit.forward.rendering import Picture, face_pixels, light_probe, render_picture
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.face_color import face_tone
from facestage.fit.given.metrics import psnr
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.result.finer_photo import finer_photo
from facestage.fit.result.left_out import left_out
from facestage.fit.runs.trace import DETAIL
from facestage.fit.stereo.stereo_term import StereoTerm
from facestage.fit.textures.refine import Refined, refine
from facestage.fit.trust.advice import verdict
from facestage.fit.trust.fitted import Fitted
from facestage.images.image_io import resize, write_exr, write_png
from facestage.report import ReportData, write_report
from facestage.system.freed_memory import give_back_freed_memory

# Errors against a truth that the end of the landmark phases is compared by.
STARTS = ("similarity_mm", "covered_mm")


@dataclass(frozen=True)
class Finished:
    """Everything a result folder shows."""

    state: State
    refined: Refined
    picture: Picture
    errors: dict[str, float]
    timings: dict[str, float]
    trace: list[dict[str, Any]]


def finish(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    truth: Truth | None,
    shared: Refined | None = None,
) -> Finished:
    """Add the albedo detail and render the fitted face at the photo's size, relit from both sides
    too.

    ``shared``: the maps, where several photos have made them.
    """
    started = time.monotonic()
    if shared is None:
        finer, finely = finer_photo(problem, fitted)
        refined = refine(finer, forward, finely)
        del finer, finely
        give_back_freed_memory()
    else:
        refined = shared
    detail_seconds = time.monotonic() - started
    started = time.monotonic()
    picture = render_picture(
        forward,
        fitted.state,
        fitted.stage,
        refined.textures,
        problem.job.seed,
        relight=_side_lights(problem, fitted.stage) if problem.fineness.report else {},
        by_light=_relightable(problem, forward, fitted),
        rays=problem.fineness.picture_rays,
    )
    timings = {"albedo_detail": detail_seconds, "render": time.monotonic() - started}
    errors = _errors(problem, forward, fitted, refined, picture, truth)
    last: dict[str, Any] = {
        "seconds": fitted.seconds + sum(timings.values()),
        "stage": DETAIL,
        "iteration": 1,
        "energy": fitted.energy,
        "psnr": errors.get("psnr"),
        "photo_rms": _rms(problem, picture),
    }
    last |= {name: errors[name] for name in ("rigid_mm", "similarity_mm") if name in errors}
    return Finished(fitted.state, refined, picture, errors, timings, [*fitted.trace, last])


def _rms(problem: Problem, picture: Picture) -> float | None:
    seen = picture.fitted & problem.photograph.mask
    if not seen.any():
        return None
    return float(np.sqrt(((picture.color - problem.photograph.color)[seen] ** 2).mean()))


def _relightable(problem: Problem, forward: ForwardModel, fitted: Fitted) -> bool:
    """Whether the final picture traces all that a relight cache holds: every light of the stage, at
    this size.
    """
    box = len(face_pixels(forward, fitted.state))
    return (
        problem.window.uncut
        and bool(problem.lit.all())
        and relight_scale(box, len(fitted.stage)) == 1
    )


def _side_lights(problem: Problem, stage: LightStage) -> dict[str, np.ndarray]:
    """Radiance (N, 3) with only the lights on one side of the face, as bright together as all
    were.
    """
    side = problem.lit_stage.position[:, 0]
    total = stage.radiance.sum()
    result = {}
    for name, lit in (("left", side < 0), ("right", side > 0)):
        if lit.any() and total > 0:
            result[f"from the {name}"] = np.where(
                lit[:, None], total / (3.0 * lit.sum()), 0.0
            ) * np.ones(3)
    return result


def _errors(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    refined: Refined,
    picture: Picture,
    truth: Truth | None,
) -> dict[str, float]:
    state, photo, textures = fitted.state, problem.photograph, refined.textures
    seen = picture.fitted & photo.mask
    skin = (problem.skin > 0.5) & (problem.clear(picture.coverage > 0.5) > 0.5)
    skin &= ~(fitted.hidden | fitted.shadowed)
    if refined.hanging is not None:
        skin &= resize(refined.hanging.astype(np.float32), *photo.size) < 0.5
    errors: dict[str, float | None] = {
        "psnr": psnr(picture.color, photo.color, seen, problem.white),
        # Without what the color model took for hair, cloth or glasses, what lies beside these, and
        # what something flat hides or throws a shadow on, or hair that hangs before it.
        "psnr_skin": psnr(picture.color, photo.color, seen & skin, problem.white),
    }
    projected = landmark_pixels(problem.geometry, problem.landmarks, state)
    distance = np.linalg.norm(projected - problem.landmarks.points, axis=1)
    errors["landmark_statistic"] = fitted.landmark_statistic
    if fitted.support is not None:
        errors["shape_deviation"] = fitted.support.photo_mm
        errors["landmark_shape_deviation"] = fitted.support.landmarks_mm
    if fitted.color is not None and np.isfinite(fitted.color.skin):
        errors["skin_color_deviation"] = fitted.color.skin
    errors["skin_tone"] = face_tone(problem.geometry, textures.albedo)
    errors["landmark_px"] = (
        float(np.median(distance[problem.landmarks.counted])) / problem.window.factor
    )
    if truth is not None:
        errors |= truth.geometry_errors(state) | truth.covered_errors(state)
        # The landmark phases' own error: a fit must never end further from the truth than its
        # start.
        start = truth.geometry_errors(fitted.start) | truth.covered_errors(fitted.start)
        errors |= {f"landmark_stage_{name}": start[name] for name in STARTS if name in start}
        if fitted.certainty.vertices_mm is not None:
            errors |= truth.calibration(state, fitted.certainty.vertices_mm)
        errors["light"] = truth.light_error(fitted.stage, state.translation)
        errors["albedo"] = truth.albedo_error(textures.albedo)
        errors |= truth.tone_errors(textures.albedo)
        errors |= truth.normal_errors(forward, state, textures.normal)
    return {
        name: value for name, value in errors.items() if value is not None and np.isfinite(value)
    }


def write_result(
    folder: Path, problem: Problem, fitted: Fitted, finished: Finished, timings: dict[str, float]
) -> Result:
    """Write every file of the result into an existing folder."""
    model, state = problem.geometry.model, finished.state
    stage = _whole_stage(problem, fitted.stage, fitted.camera_to_stage)
    vertices = problem.geometry.all_vertices(state) @ state.rotation.T + state.translation
    told = EYES in finished.refined.told
    status, advice = verdict(problem, fitted, finished.picture, finished.errors, told)
    result = Result(
        status=status,
        advice=advice,
        model=problem.job.model,
        camera=problem.window.full_camera(state.camera),
        camera_to_stage=fitted.camera_to_stage,
        model_to_camera=state.model_to_camera,
        **as_fields(Result, kept(state)),
        stage=stage,
        vertices=vertices.astype(np.float32),
        triangles=model.triangles,
        identity_names=model.identity_names,
        expression_names=model.expression_names,
        energy=fitted.energy,
        errors=finished.errors,
        timings=timings | finished.timings,
        left_out=left_out(problem, fitted),
        unobserved=fitted.certainty.unobserved,
        null_directions=fitted.certainty.directions,
        model_origin={"name": model.name, "license": model.license, "source": model.source},
        photo=problem.read_from_photo() | _found_of_light(problem, fitted),
        versions=_versions(),
        seed=problem.job.seed,
        arrays={"condition": np.array(fitted.condition)}
        | _vertex_arrays(problem, fitted)
        | _fold_arrays(finished.refined)
        | {f"deviation/{name}": value for name, value in fitted.certainty.deviations.items()}
        | {f"deviation_before/{name}": value for name, value in fitted.certainty.before.items()},
        folder=folder,
    )
    result.write_into(folder)
    problem.job.write_into(folder, copy_image=False)
    assert problem.job.landmarks is not None
    write_json(folder / LANDMARKS, problem.job.landmarks.to_json())
    probe = light_probe(stage)
    # Compressing what is large takes as long as the report, which needs none of it.
    with ThreadPoolExecutor(2) as pool:
        written = [
            pool.submit(write_exr, folder / name, image)
            for name, image in _maps(problem, finished, probe).items()
        ]
        write_png(folder / COVERAGE, finished.refined.coverage)
        lines = [json.dumps(finite(row)) for row in finished.trace]
        (folder / TRACE).write_text("".join(line + "\n" for line in lines), encoding="utf-8")
        if problem.fineness.report:
            write_report(folder, _report_data(problem, fitted, finished, result, probe))
        for each in written:
            each.result()
    # The fingerprint is of the maps' files, too.
    cache = finished.picture.relight_cache(relight_fingerprint(result))
    if cache is not None:
        cache.save(folder)
    return result


def _maps(problem: Problem, finished: Finished, probe: np.ndarray) -> dict[str, np.ndarray]:
    """The linear pictures of a result, by their files' names."""
    refined = finished.refined
    textures = refined.textures.known
    maps = {each.file: textures[each.name] for each in TEXTURE_MAPS if each.name in textures}
    if refined.eyes is not None:
        maps[EYE_MAP.file] = refined.eyes
    if refined.folds is not None:
        maps[FOLD_MAP.file] = refined.folds.ratio
    maps[RENDER] = problem.window.enlarged(finished.picture.color)
    maps[LIGHT_PROBE] = probe
    return maps


def _found_of_light(problem: Problem, fitted: Fitted) -> dict[str, str]:
    """What the fit found of the lights before it fitted any, in words."""
    words, found = [], fitted.surround
    if problem.grey is not None:
        shares = ", ".join(f"{value:.2f}" for value in problem.grey / problem.grey.mean())
        words.append(f"white balance as given: grey is {shares} (red, green, blue)")
    if problem.exposure != 1.0:
        words.append(f"held lights {problem.exposure:.3g} times as bright as given, by mean skin")
    if found is not None and found.joined:
        count = len(found.lights)
        words.append(f"{count} lights behind the face joined the stage's: {found.words}")
    return {"light": "; ".join(words)} if words else {}


def _vertex_arrays(problem: Problem, fitted: Fitted) -> dict[str, np.ndarray]:
    """Each vertex's standard deviation in mm (n, 3) along the camera's axes, where any parameter
    was fitted, and its relief, where there is any.
    """
    found: dict[str, np.ndarray] = {}
    if fitted.certainty.vertices_mm is not None:
        found[DEVIATION] = fitted.certainty.vertices_mm
    if fitted.state.relief.any():
        found[RELIEF] = problem.geometry.relief(fitted.state)
    return found


def _fold_arrays(refined: Refined) -> dict[str, np.ndarray]:
    return {} if refined.folds is None else refined.folds.folds.arrays


def _whole_stage(problem: Problem, lit: LightStage, camera_to_stage: np.ndarray) -> LightStage:
    """The job's stage (stage frame) with what was fitted of the lit lights filled in: radiance and
    place.
    """
    arrays = {name: np.array(getattr(problem.stage, name)) for name in LIGHT_ARRAYS}
    arrays["radiance"] = np.zeros_like(problem.stage.radiance, dtype=float)
    placed = lit.transformed(camera_to_stage)
    for name in ("position", "direction", "axis_x", "radiance"):
        arrays[name][problem.lit] = getattr(placed, name)
    return LightStage(**arrays)


def _versions() -> dict[str, str]:
    names = ("mitsuba", "drjit", "numpy", "scipy", "opencv-contrib-python-headless")
    found = {"facestage": __version__, "python": platform.python_version()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed as a package"
    return found


def _report_data(
    problem: Problem, fitted: Fitted, finished: Finished, result: Result, probe: np.ndarray
) -> ReportData:
    model, state = problem.geometry.model, finished.state
    projected = landmark_pixels(problem.geometry, problem.landmarks, state)
    return ReportData(
        result=result,
        photo=problem.photograph.color,
        render=finished.picture.color,
        alpha=finished.picture.coverage,
        coverage=finished.picture.fitted & problem.photograph.mask,
        maps=finished.refined.textures.known,
        texture_coverage=finished.refined.coverage,
        light_probe=probe,
        relit=finished.picture.relit,
        landmarks=problem.landmarks.points,
        projected=projected,
        visible=problem.landmarks.counted,
        trace=finished.trace,
        energy_names=words_of_energies() | StereoTerm.words,
        title=problem.job.image.stem,
        surface=model.triangles[model.triangle_part != OTHER],
        face=model.regions.get(FACE),
    )
