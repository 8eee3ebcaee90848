"""Everything a report is drawn from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.result import Result
from facestage.contract.texture_maps import TEXTURE_MAPS

# The saved job lies beside the report, so the command holds wherever the folder is moved.
REPEAT_COMMAND = "facestage fit --job . --out ../again"


@dataclass(frozen=True)
class ReportData:
    """A finished fit. Images are linear RGB; NaN and infinity may occur anywhere and are drawn as
    black or white.

    ``trace`` holds rows as in trace.jsonl: "seconds", "stage", "iteration", "energy" (term ->
    value), "photo_rms", "psnr", "condition" and, when truth is known, "rigid_mm" and
    "similarity_mm"; a missing value is None. Raises InputError when two arrays that belong together
    differ in size.
    """

    title: str
    result: Result
    photo: np.ndarray  # (h, w, 3) linear
    render: np.ndarray  # (h, w, 3) linear, premultiplied by alpha
    alpha: np.ndarray  # (h, w) share of the pixel that the rendered head covers
    coverage: np.ndarray  # (h, w) bool, true where the face was fitted
    # By the names of TEXTURE_MAPS, (S, S, 3) linear or (s, s), row 0 at v = 1. What is missing has
    # the result's one value everywhere.
    maps: Mapping[str, np.ndarray]
    # (H, W, 3) lat-long, stage frame: +Y at the top, +Z (the camera) in the middle
    light_probe: np.ndarray
    landmarks: np.ndarray  # (m, 2) pixels, as given
    projected: np.ndarray  # (m, 2) pixels, as fitted
    visible: np.ndarray  # (m,) bool
    # (S, S, 3) uint8, where the albedo's texels are from (CONVENTIONS.md)
    texture_coverage: np.ndarray | None = None
    relit: Mapping[str, np.ndarray] = field(default_factory=dict)  # name -> (h, w, 3) linear
    # (t, 3) the rendered triangles of the result's vertices; None: all
    surface: np.ndarray | None = None
    # (f,) numbers of the face's vertices, without neck and scalp; None: all
    face: np.ndarray | None = None
    trace: Sequence[Mapping[str, Any]] = ()
    energy_names: Mapping[str, str] = field(default_factory=dict)  # what people call each energy
    repeat_command: str = REPEAT_COMMAND

    def __post_init__(self) -> None:
        size = self.photo.shape[:2]
        count = len(self.landmarks)
        expected = {
            "photo": (*size, 3),
            "render": (*size, 3),
            "alpha": size,
            "coverage": size,
            "landmarks": (count, 2),
            "projected": (count, 2),
            "visible": (count,),
            "light_probe": (*self.light_probe.shape[:2], 3),
        }
        if self.texture_coverage is not None:
            expected["texture_coverage"] = (*self.maps["albedo"].shape[:2], 3)
        shapes = {name: getattr(self, name).shape for name in expected}
        for each in TEXTURE_MAPS:
            if each.name in self.maps:
                shapes[each.name] = self.maps[each.name].shape
                expected[each.name] = (
                    *shapes[each.name][:2],
                    *((3,) if each.channels == 3 else ()),
                )
        for name, shape in expected.items():
            if shapes[name] != shape:
                raise InputError(f"The report's {name} has shape {shapes[name]}, expected {shape}.")
        for name, picture in self.relit.items():
            if picture.ndim != 3 or picture.shape[2] != 3:
                raise InputError(
                    f"The report's relit picture '{name}' has shape {picture.shape}, expected "
                    "(h, w, 3)."
                )
