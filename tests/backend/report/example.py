"""A small finished fit with everything a report shows, deterministic."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.light_stage import OFF, LightStage, fibonacci_stage
from facestage.contract.result import Result
from facestage.report import ReportData


def stage(count: int = 20) -> LightStage:
    lights = fibonacci_stage(count)
    radiance = np.random.default_rng(1).gamma(1.0, 2.0, (count, 3))
    radiance[1::3] = 0.0
    state = np.where(radiance.max(1) > 0, lights.state, OFF)
    return replace(lights, radiance=radiance, state=state)


def result(lights: LightStage, size: tuple[int, int] = (48, 40), **changes: Any) -> Result:
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, -0.8]
    values: dict[str, Any] = {
        "status": "converged",
        "advice": "It converged <well>.",
        "model": "default",
        "camera": Camera.default(size[1], size[0]),
        "camera_to_stage": np.eye(4),
        "model_to_camera": pose,
        "identity": np.array([0.5, -2.25, 0.0]),
        "expression": np.array([0.0, 0.75]),
        "albedo": np.zeros(2),
        "specular": np.full((4, 4), 0.5),
        "roughness": 0.4321,
        "stage": lights,
        "vertices": np.zeros((3, 3), np.float32),
        "triangles": np.array([[0, 1, 2]], np.int32),
        "identity_names": ("width", "nose", "chin"),
        "expression_names": ("blink", "smile"),
        "energy": {"photo": 81.25, "landmarks": 4.5},
        "errors": {"psnr": 33.17, "landmark_px": 1.294, "rigid_mm": 1.876},
        "timings": {"cold_start": 1.5, "optimisation": 12.25},
        "versions": {"numpy": "1.2.3"},
        "seed": 90817,
        "model_origin": {"name": "Head", "license": "CC0 & free", "source": "made for tests"},
        "left_out": [{"what": "7 lights", "why": "switched off", "saved": "7 of 20 lights"}],
    }
    return Result(**(values | changes))


def trace() -> list[dict[str, Any]]:
    rows = []
    for number in range(12):
        stage_name = ("landmarks", "light_and_albedo", "joint")[number // 4]
        rms = None if number < 4 else 0.1 * 0.8**number
        rows.append(
            {
                "seconds": 0.05 * 1.6**number,
                "stage": stage_name,
                "iteration": number % 4 + 1,
                "energy": {"photo": 1.0},
                "photo_rms": rms,
                "psnr": None if rms is None else -20 * np.log10(rms),
                "condition": 1e4,
                "rigid_mm": 3.0 - 0.1 * number,
                "similarity_mm": 2.0 - 0.05 * number,
            }
        )
    return rows


def report_data(size: tuple[int, int] = (48, 40), lights: int = 20, **changes: Any) -> ReportData:
    height, width = size
    rng = np.random.default_rng(0)
    photo = rng.uniform(0.0, 0.9, (height, width, 3)).astype(np.float32)
    rows, columns = np.mgrid[:height, :width]
    coverage = np.hypot((rows - height / 2) / height, (columns - width / 2) / width) < 0.35
    landmarks = rng.uniform(0.3, 0.7, (68, 2)) * [width, height]
    light_stage = stage(lights)
    maps = {"albedo": rng.uniform(0.2, 0.6, (16, 16, 3)), "specular": np.full((4, 4), 0.5)}
    maps["roughness"] = np.full((4, 4), 0.4)
    values: dict[str, Any] = {
        "title": "Ada & friends",
        "result": result(light_stage, size),
        "photo": photo,
        "render": np.where(coverage[..., None], 0.9 * photo, 0.0),
        "alpha": coverage.astype(np.float32),
        "coverage": coverage,
        "maps": maps,
        "light_probe": rng.uniform(0.0, 3.0, (8, 16, 3)),
        "landmarks": landmarks,
        "projected": landmarks + np.array([3.0, 4.0]),
        "visible": np.arange(68) % 5 > 0,
        "texture_coverage": 255 * np.eye(16, dtype=np.uint8)[..., None].repeat(3, axis=2),
        "relit": {"from left": photo},
        "trace": trace(),
    }
    return ReportData(**(values | changes))
