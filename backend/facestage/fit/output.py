"""From the end of the schedule to a result folder: texture detail, pictures, numbers."""

from __future__ import annotations

import json
import platform
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from facestage import __version__
from facestage.contract import brdf
from facestage.contract.face_model import EYES, OTHER, TEETH
from facestage.contract.light_stage import LIGHT_ARRAYS, LightStage
from facestage.contract.relight_cache import relight_fingerprint
from facestage.contract.result import Result
from facestage.contract.storage import finite
from facestage.fit.advice import verdict
from facestage.fit.driver import Fitted
from facestage.fit.left_out import left_out
from facestage.fit.metrics import psnr
from facestage.fit.one_light import relight_scale
from facestage.fit.parameters import State
from facestage.fit.problem import Problem
from facestage.fit.rendering import Picture, Textures, face_pixels, light_probe, render_picture
from facestage.fit.shading import ForwardModel, sample_bilinear
from facestage.fit.texture import Atlas, detail_texture
from facestage.fit.truth import Truth
from facestage.image_io import resize, write_exr
from facestage.report import ReportData, write_report

# Texels along the atlas per pixel of the face: the face fills about half of it.
TEXELS_PER_FACE_PX, TEXTURE_MIN, TEXTURE_MAX = 3.0, 512, 2048
SPECULAR_TEXTURE = 256
DETAIL_SAMPLES = 16
WET_SPECULAR = 1.0  # eyes and teeth: a clear dielectric layer


@dataclass(frozen=True)
class Finished:
    """Everything a result folder shows."""

    state: State
    textures: Textures
    texture_coverage: np.ndarray  # (S, S) bool: texels that the photo shows
    picture: Picture
    errors: dict[str, float]
    timings: dict[str, float]
    trace: list[dict[str, Any]]


def finish(problem: Problem, forward: ForwardModel, fitted: Fitted, truth: Truth | None) -> Finished:
    """Add the albedo detail and render the fitted face at the photo's size, relit from both sides too."""
    started = time.monotonic()
    albedo, coverage = _albedo_texture(problem, forward, fitted)
    textures = Textures(albedo, _specular_texture(problem, fitted.state))
    detail_seconds = time.monotonic() - started
    started = time.monotonic()
    picture = render_picture(
        forward, fitted.state, fitted.stage, textures, problem.job.seed, relight=_side_lights(problem, fitted.stage),
        by_light=_relightable(problem, forward, fitted),
    )  # fmt: skip
    timings = {"albedo_detail": detail_seconds, "render": time.monotonic() - started}
    errors = _errors(problem, fitted, albedo, picture, truth)
    last: dict[str, Any] = {
        "seconds": fitted.seconds + sum(timings.values()), "stage": "albedo detail", "iteration": 1,
        "energy": fitted.energy, "psnr": errors.get("psnr"), "photo_rms": _rms(problem, picture),
    }  # fmt: skip
    last |= {name: errors[name] for name in ("rigid_mm", "similarity_mm") if name in errors}
    return Finished(fitted.state, textures, coverage, picture, errors, timings, [*fitted.trace, last])


def _rms(problem: Problem, picture: Picture) -> float | None:
    seen = picture.fitted & problem.photograph.mask
    if not seen.any():
        return None
    return float(np.sqrt(((picture.color - problem.photograph.color)[seen] ** 2).mean()))


def _relightable(problem: Problem, forward: ForwardModel, fitted: Fitted) -> bool:
    """Whether the final picture traces all that a relight cache holds: every light of the stage, at this size."""
    box = len(face_pixels(forward, fitted.state))
    return bool(problem.lit.all()) and relight_scale(box, len(fitted.stage)) == 1


def _side_lights(problem: Problem, stage: LightStage) -> dict[str, np.ndarray]:
    """Radiance (N, 3) with only the lights on one side of the face, as bright together as all were."""
    side = problem.lit_stage.position[:, 0]
    total = stage.radiance.sum()
    result = {}
    for name, lit in (("left", side < 0), ("right", side > 0)):
        if lit.any() and total > 0:
            result[f"from the {name}"] = np.where(lit[:, None], total / (3.0 * lit.sum()), 0.0) * np.ones(3)
    return result


def _albedo_texture(problem: Problem, forward: ForwardModel, fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """(S, S, 3) albedo and (S, S) bool, which texels the photo shows."""
    size = TEXTURE_MIN
    while size < min(TEXELS_PER_FACE_PX * problem.face_size_px, TEXTURE_MAX):
        size *= 2
    atlas = Atlas.build(problem.geometry, size)
    logs = atlas.bake(forward.log_albedo(fitted.state))
    coverage = np.zeros((size, size), bool)
    y, x = np.nonzero(problem.photograph.mask)
    surface = forward.surface(fitted.state, np.stack([x, y], axis=1) + 0.5, only_fitted=True)
    if "albedo" not in problem.job.freeze and len(surface.pixels):
        terms = forward.light_terms(fitted.state, surface, fitted.stage, DETAIL_SAMPLES, problem.job.seed)
        image = forward.shade(fitted.state, surface, terms)
        column, row = surface.pixels.astype(int).T
        cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
        weights = np.clip((cosine - 0.15) / 0.3, 0, 1) * (problem.paintable * ~fitted.hidden)[row, column]
        weights = weights[:, None] * ~problem.photograph.clipped[row, column]
        doubt = _shading_doubt(problem, fitted)[row, column]
        photo = problem.photograph.color[row, column]
        detail, coverage = detail_texture(atlas, logs, image, forward.uvs(surface), photo, weights, doubt)
        logs = logs + detail
    return np.minimum(np.exp(logs), brdf.ALBEDO_MAX).astype(np.float32), coverage


def _shading_doubt(problem: Problem, fitted: Fitted) -> np.ndarray:
    """(h, w) at the photo's size, see shading_doubt.py; 0 where nothing is known of it."""
    width, height = problem.photograph.size
    if fitted.shading_doubt is None:
        return np.zeros((height, width))
    return resize(fitted.shading_doubt.astype(np.float32), width, height)


def _errors(
    problem: Problem, fitted: Fitted, texture: np.ndarray, picture: Picture, truth: Truth | None
) -> dict[str, float]:
    state, photo = fitted.state, problem.photograph
    seen = picture.fitted & photo.mask
    errors: dict[str, float | None] = {
        "psnr": psnr(picture.color, photo.color, seen, problem.white),
        # Without what the color model took for hair, cloth or glasses, and what something flat hides.
        "psnr_skin": psnr(picture.color, photo.color, seen & (problem.skin > 0.5) & ~fitted.hidden, problem.white),
    }
    vertices, weights = problem.geometry.model.landmark_vertices(problem.landmarks.scheme)
    shape = problem.geometry.vertices(state.identity, state.expression)[problem.geometry.new_index[vertices]]
    points = np.einsum("mi,mix->mx", weights, shape) @ state.rotation.T + state.translation
    distance = np.linalg.norm(state.camera.project(points) - problem.landmarks.points, axis=1)
    errors["landmark_statistic"] = fitted.landmark_statistic
    errors["landmark_px"] = float(np.median(distance[problem.landmarks.visible]))
    if truth is not None:
        errors |= truth.geometry_errors(state)
        # The landmark stage's own error: a fit must never end further from the truth than its start.
        start = [row for row in fitted.trace if row["stage"] == "landmarks"]
        if start:
            errors["landmark_stage_similarity_mm"] = start[-1]["similarity_mm"]
        if fitted.certainty.vertices_mm is not None:
            errors |= truth.calibration(state, fitted.certainty.vertices_mm)
        errors["light"] = truth.light_error(fitted.stage, state.translation)
        errors["albedo"] = truth.albedo_error(texture)
    return {name: value for name, value in errors.items() if value is not None and np.isfinite(value)}


def write_result(
    folder: Path, problem: Problem, fitted: Fitted, finished: Finished, timings: dict[str, float]
) -> Result:
    """Write every file of the result into an existing folder."""
    model, state = problem.geometry.model, finished.state
    stage = _whole_stage(problem, fitted.stage, fitted.camera_to_stage)
    vertices = model.shape(state.identity, state.expression) @ state.rotation.T + state.translation
    status, advice = verdict(problem, fitted, finished.picture, finished.errors)
    result = Result(
        status=status, advice=advice,
        model=problem.job.model, camera=state.camera, camera_to_stage=fitted.camera_to_stage,
        model_to_camera=state.model_to_camera, identity=state.identity, expression=state.expression,
        albedo=state.albedo, specular=state.specular, roughness=state.roughness, stage=stage,
        vertices=vertices.astype(np.float32), triangles=model.triangles,
        identity_names=model.identity_names, expression_names=model.expression_names,
        energy=fitted.energy, errors=finished.errors, timings=timings | finished.timings,
        left_out=left_out(problem, fitted), unobserved=fitted.certainty.unobserved,
        null_directions=fitted.certainty.directions,
        model_origin={"name": model.name, "license": model.license, "source": model.source},
        versions=_versions(), seed=problem.job.seed,
        arrays={"condition": np.array(fitted.condition)} | _vertex_arrays(fitted)
        | {f"deviation/{name}": value for name, value in fitted.certainty.deviations.items()}
        | {f"deviation_before/{name}": value for name, value in fitted.certainty.before.items()},
        folder=folder,
    )  # fmt: skip
    result.write_into(folder)
    problem.job.write_into(folder, copy_image=False)
    write_exr(folder / "albedo.exr", finished.textures.albedo)
    write_exr(folder / "specular.exr", finished.textures.specular)
    write_exr(folder / "render.exr", finished.picture.color)
    cache = finished.picture.relight_cache(relight_fingerprint(result))
    if cache is not None:
        cache.save(folder)
    probe = light_probe(stage)
    write_exr(folder / "light_probe.exr", probe)
    lines = [json.dumps(finite(row)) for row in finished.trace]
    (folder / "trace.jsonl").write_text("".join(line + "\n" for line in lines), encoding="utf-8")
    write_report(folder, _report_data(problem, fitted, finished, result, probe))
    return result


def _vertex_arrays(fitted: Fitted) -> dict[str, np.ndarray]:
    """Each vertex's standard deviation in mm (n, 3) along the camera's axes, where any parameter was fitted."""
    found = fitted.certainty.vertices_mm
    return {} if found is None else {"vertex_deviation_mm": found}


def _whole_stage(problem: Problem, lit: LightStage, camera_to_stage: np.ndarray) -> LightStage:
    """The job's stage (stage frame) with what was fitted of the lit lights filled in: radiance and place."""
    arrays = {name: np.array(getattr(problem.stage, name)) for name in LIGHT_ARRAYS}
    arrays["radiance"] = np.zeros_like(problem.stage.radiance, dtype=float)
    placed = lit.transformed(camera_to_stage)
    for name in ("position", "direction", "axis_x", "radiance"):
        arrays[name][problem.lit] = getattr(placed, name)
    return LightStage(**arrays)


def _specular_texture(problem: Problem, state: State) -> np.ndarray:
    """(SPECULAR_TEXTURE, SPECULAR_TEXTURE) c_spec: the fitted map on skin, a clear layer on eyes and teeth."""
    atlas = Atlas.build(problem.geometry, SPECULAR_TEXTURE)
    centre = (np.arange(SPECULAR_TEXTURE) + 0.5) / SPECULAR_TEXTURE
    u, v = np.meshgrid(centre, 1 - centre)
    texture = sample_bilinear(state.specular, np.stack([u.ravel(), v.ravel()], axis=1)).reshape(u.shape)
    wet = np.isin(problem.geometry.triangle_part, (EYES, TEETH))
    vertex_wet = np.zeros(len(problem.geometry.mean), np.float32)
    vertex_wet[problem.geometry.triangles[wet]] = 1.0
    return np.where(atlas.bake(vertex_wet[:, None])[..., 0] > 0.5, WET_SPECULAR, texture).astype(np.float32)


def _versions() -> dict[str, str]:
    names = ("mitsuba", "drjit", "numpy", "scipy", "opencv-contrib-python-headless")
    found = {"facestage": __version__, "python": platform.python_version()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed as a package"
    return found


def _report_data(problem: Problem, fitted: Fitted, finished: Finished, result: Result, probe: np.ndarray) -> ReportData:
    model, state = problem.geometry.model, finished.state
    vertices, weights = model.landmark_vertices(problem.landmarks.scheme)
    points = np.einsum("mi,mix->mx", weights, result.vertices[vertices])
    return ReportData(
        result=result, photo=problem.photograph.color, render=finished.picture.color,
        coverage=finished.picture.fitted & problem.photograph.mask, albedo=finished.textures.albedo,
        specular=finished.textures.specular, texture_coverage=finished.texture_coverage, light_probe=probe,
        relit=finished.picture.relit, landmarks=problem.landmarks.points, projected=state.camera.project(points),
        visible=problem.landmarks.visible, trace=finished.trace, title=problem.job.image.stem,
        surface=model.triangles[model.triangle_part != OTHER], face=model.regions.get("narrow_face"),
    )  # fmt: skip
