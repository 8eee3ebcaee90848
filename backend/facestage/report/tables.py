"""The numbers of a fit as rows of words, values and units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from facestage.contract.light_stage import FROZEN, OFF, LightStage
from facestage.contract.result import Result
from facestage.report.color import to_srgb8
from facestage.report.light_picture import light_power

NOTHING = "–"
# Key of Result.errors -> what it measures and its unit.
ERRORS = {
    "photo_rms": ("Photo residual, RMS", "linear"),
    "psnr": ("Peak signal-to-noise ratio", "dB"),
    "psnr_skin": ("Peak signal-to-noise ratio on the skin", "dB"),
    "rigid_mm": ("Vertices after rigid alignment, mean (a scan's points: median)", "mm"),
    "rigid_mean_mm": ("A scan's points after rigid alignment, mean", "mm"),
    "rigid_90_percent_mm": ("A scan's points after rigid alignment, 90 % are nearer", "mm"),
    "similarity_mm": ("Vertices after similarity alignment, mean (a scan's points: median)", "mm"),
    "similarity_mean_mm": ("A scan's points after similarity alignment, mean", "mm"),
    "similarity_90_percent_mm": ("A scan's points after similarity alignment, 90 % nearer", "mm"),
    "covered": ("Share of the scan's points that the mesh covers", ""),
    "covered_mm": ("These alone after similarity alignment to them, median", "mm"),
    "covered_within_1_sigma": ("These alone within 1 standard deviation", ""),
    "covered_within_2_sigma": ("These alone within 2 standard deviations", ""),
    "landmark_stage_similarity_mm": ("Similarity, after the landmark stage alone", "mm"),
    "landmark_stage_covered_mm": ("Covered points, after the landmark stage alone", "mm"),
    "within_1_sigma": ("Coordinates or points within 1 standard deviation (0.68 is honest)", ""),
    "within_2_sigma": ("Coordinates or points within 2 standard deviations (0.95)", ""),
    "error_over_sigma": ("Error over standard deviation, RMS (1)", ""),
    "landmark_statistic": ("Squared distance from the landmarks' shape", ""),
    "shape_deviation": ("Deviation of the shape, by the fit's own account, RMS", "mm"),
    "landmark_shape_deviation": ("The same by landmarks alone", "mm"),
    "skin_color_deviation": (
        "Deviation of the skin's red over blue, by the fit's own account",
        "relative",
    ),
    "skin_tone": ("Skin tone, individual typology angle", "°"),
    "landmark_px": ("Landmarks, median distance", "px"),
    "albedo": ("Albedo, RMS, best scale factored out", "linear"),
    "mesh_normal_degrees": ("Normals of the mesh alone, mean angle", "°"),
    "normal_degrees": ("Normals with the normal map, mean angle", "°"),
    "light": ("Irradiance, relative, best scale factored out", ""),
    "condition": ("Condition number of the last step", ""),
}
SUFFIX_UNITS = {
    "mm": "mm",
    "px": "px",
    "db": "dB",
    "deg": "°",
    "degrees": "°",
    "percent": "%",
    "seconds": "s",
}
TRUTH_WORDS = (
    "sigma",
    "rigid",
    "similarity",
    "covered",
    "truth",
    "albedo",
    "light",
    "specular",
    "vertex",
    "vertices",
    "roughness",
    "normal",
)


@dataclass(frozen=True)
class Row:
    """One measured value: what it is, its number as text, its unit."""

    label: str
    value: str
    unit: str = ""


def number(value: Any, digits: int = 4) -> str:
    """A number with ``digits`` significant digits for people; a dash for what is missing or not
    finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return NOTHING if value is None else str(value)
    if isinstance(value, int | np.integer):
        return f"{value:,}".replace(",", " ")
    if not math.isfinite(value):
        return NOTHING
    magnitude = abs(float(value))
    if magnitude != 0 and not 1e-4 <= magnitude < 1e6:
        mantissa, exponent = f"{value:.{digits - 2}e}".split("e")
        return f"{mantissa} × 10{_superscript(int(exponent))}".replace(
            "-", "−", 1 if value < 0 else 0
        )
    return f"{float(f'{value:.{digits}g}'):g}".replace("-", "−")


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def words(key: str) -> str:
    """A name of the code as words: "landmark_stage" -> "Landmark stage"."""
    text = key.replace("_", " ").strip()
    return text[:1].upper() + text[1:]


def error_row(key: str, value: Any) -> Row:
    """The row of one entry of Result.errors; an unknown key's unit is read from its last word."""
    if key in ERRORS:
        label, unit = ERRORS[key]
        return Row(label, number(value), unit)
    stem, _, suffix = key.rpartition("_")
    if stem and suffix in SUFFIX_UNITS:
        return Row(words(stem), number(value), SUFFIX_UNITS[suffix])
    return Row(words(key), number(value))


def error_tables(errors: Mapping[str, Any]) -> tuple[list[Row], list[Row]]:
    """Rows measured on the photo, and rows that need known truth (often none)."""
    on_photo: list[Row] = []
    against_truth: list[Row] = []
    for key, value in errors.items():
        needs_truth = key.endswith("_mm") or any(
            word in TRUTH_WORDS for word in key.lower().split("_")
        )
        (against_truth if needs_truth else on_photo).append(error_row(key, value))
    return on_photo, against_truth


@dataclass(frozen=True)
class CertaintyRow:
    """One fitted weight: value and standard deviation, and how much of its prior's deviation is
    left, 0..1.
    """

    name: str
    kind: str
    value: str
    deviation: str
    left: float


def certainty_rows(result: Result, count: int = 12) -> list[CertaintyRow]:
    """The least certain of the identity and expression weights that the data say something of."""
    rows = []
    blocks = (
        ("identity", result.identity_names, result.identity),
        ("expression", result.expression_names, result.expression),
    )
    for kind, names, values in blocks:
        after, before = (
            result.arrays.get(f"{key}/{kind}") for key in ("deviation", "deviation_before")
        )
        if after is None or before is None:
            continue
        unobserved = set(result.unobserved.get(kind, ()))
        rows += [
            CertaintyRow(
                name,
                kind,
                number(float(value), 2),
                number(float(deviation), 2),
                float(deviation / prior),
            )
            for name, value, deviation, prior in zip(names, values, after, before, strict=True)
            if name not in unobserved and deviation > 0 and np.isfinite(prior) and prior > 0
        ]
    return sorted(rows, key=lambda row: -row.left)[:count]


def relief_sentence(result: Result) -> str:
    """How far the shape goes beyond the face model's; empty where it does not."""
    if result.relief is None:
        return ""
    height = 1e3 * np.linalg.norm(result.relief, axis=1)
    moved = height[height > 0]
    size = float(np.sqrt((moved**2).mean())) if len(moved) else 0.0
    return (
        "What the photos together say of the shape beyond the face model's: "
        f"{size:.2f} mm (root mean square over the face), at most "
        f"{float(height.max()):.2f} mm. In Blender it is the shape key Facestage Relief."
    )


def energy_rows(
    energy: Mapping[str, Any], names: Mapping[str, str]
) -> list[tuple[str, float, str]]:
    """(term, share of the total 0..1, value) of each energy term, largest first.

    ``names``: what people call a term; one that has none is called by its key.
    """
    return _shares(
        {names.get(key, words(key)): value for key, value in energy.items() if key != "total"}
    )


def timing_rows(timings: Mapping[str, Any]) -> list[tuple[str, float, str]]:
    """(what, share of the total 0..1, seconds as text), in the order given, without the total."""
    rows = {
        words(key.removesuffix("_seconds")): value
        for key, value in timings.items()
        if key != "total"
    }
    return _shares(rows, total=_finite(timings.get("total")), in_order=True)


def total_seconds(timings: Mapping[str, Any]) -> float:
    """The run's wall time: its own total, or the sum of its parts."""
    return _finite(timings.get("total")) or sum(_finite(value) for value in timings.values())


def _shares(
    rows: Mapping[str, Any], total: float = 0.0, in_order: bool = False
) -> list[tuple[str, float, str]]:
    total = max(total, sum(abs(_finite(value)) for value in rows.values()), 1e-30)
    result = [(label, abs(_finite(value)) / total, number(value)) for label, value in rows.items()]
    return result if in_order else sorted(result, key=lambda row: -row[1])


def _finite(value: Any) -> float:
    return (
        float(value) if isinstance(value, int | float | np.number) and math.isfinite(value) else 0.0
    )


@dataclass(frozen=True)
class LightRow:
    """One light: its number, where it stands seen from the face, its radiance and share of the
    power.
    """

    number: int
    place: str
    radiance: tuple[str, str, str]
    swatch: str  # CSS color
    share: float
    state: str


def light_rows(stage: LightStage) -> list[LightRow]:
    """The lights, strongest first; "right" and "left" are the photo's when the camera faces the
    stage.
    """
    power = light_power(stage)
    share = power / max(float(power.sum()), 1e-30)
    rows = []
    for index in np.argsort(-power, kind="stable"):
        color = stage.radiance[index]
        swatch = to_srgb8(color / max(float(color.max()), 1e-30))
        off = stage.state[index] == OFF or not color.any()
        state = "off" if off else "kept" if stage.state[index] == FROZEN else "fitted"
        red, green, blue = (number(float(value), 3) for value in color)
        rows.append(
            LightRow(
                int(index) + 1,
                light_place(stage.position[index]),
                (red, green, blue),
                "transparent" if off else f"rgb({swatch[0]} {swatch[1]} {swatch[2]})",
                float(share[index]),
                state,
            )
        )
    return rows


def light_place(position: np.ndarray) -> str:
    """Where a stage-frame position (3,) lies for someone at the origin who looks along +Z: "31°
    right, 12° up".
    """
    x, y, z = (float(value) for value in position / max(float(np.linalg.norm(position)), 1e-30))
    azimuth, elevation = (
        math.degrees(math.atan2(x, z)),
        math.degrees(math.asin(max(-1.0, min(1.0, y)))),
    )
    across = f"{abs(azimuth):.0f}° {'right' if azimuth > 0 else 'left'}"
    return f"{across}, {abs(elevation):.0f}° {'up' if elevation >= 0 else 'down'}"


def setup_rows(result: Result) -> list[Row]:
    """Camera, head pose and model."""
    camera, rotation = result.camera, result.model_to_camera[:3, :3]
    gaze = rotation @ np.array([0.0, 0.0, 1.0])
    yaw, pitch = math.atan2(gaze[0], gaze[2]), math.asin(max(-1.0, min(1.0, gaze[1])))
    roll = math.atan2(rotation[1, 0], rotation[1, 1])
    view = 2 * math.degrees(math.atan(0.5 * camera.width / camera.focal_px))
    return [
        Row("Face model", result.model),
        Row("Photo", f"{camera.width} × {camera.height}", "px"),
        Row("Focal length", number(camera.focal_px), "px"),
        Row("Horizontal field of view", number(view, 3), "°"),
        Row("Head to camera", number(float(np.linalg.norm(result.model_to_camera[:3, 3])), 3), "m"),
        Row(
            "Head yaw, pitch, roll",
            ", ".join(_signed_degrees(angle) for angle in (yaw, pitch, roll)),
            "°",
        ),
        Row("Roughness", number(result.roughness, 3)),
        Row(
            "Lights",
            f"{int((result.stage.radiance.max(axis=1) > 0).sum())} on of {len(result.stage)}",
        ),
        Row("Seed", str(result.seed)),
    ]


def _signed_degrees(angle: float) -> str:
    return f"{math.degrees(angle):+.1f}".replace("-", "−")


def left_out_table(left_out: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of what the plan dropped; columns are the keys in the order they first
    appear.
    """
    keys = list(dict.fromkeys(key for item in left_out for key in item))
    rows = [[_cell(key, item.get(key)) for key in keys] for item in left_out]
    return [_head(key) for key in keys], rows


def _head(key: str) -> str:
    return words(key.removesuffix("_seconds")) if key.endswith("_seconds") else words(key)


def _cell(key: str, value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(str(item) for item in value)
    text = number(value, 3)
    return f"{text} s" if key.endswith("seconds") and text != NOTHING else text
