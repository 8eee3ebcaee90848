"""Relighting a fitted face: from the images of its single lights against tracing it again."""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from facestage.bench.trace import Track
from facestage.contract.files.atomic import atomic_file
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.rendering import Textures, render_picture
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.textures.atlas import Atlas

RELIGHTING_CSV = "relighting.csv"
SIDES_PX = (256, 512)
TEXTURE_SIZE = 512
REPEATS = 20  # a picture of a millisecond is timed many times; the median counts


@dataclass(frozen=True)
class Relighting:
    """One picture size; milliseconds per picture."""

    side_px: int  # the longer one
    face_pixels: int
    lights: int
    megabytes: float  # of the cache as half floats
    cached_ms: float
    traced_ms: float
    difference: float  # largest between the two pictures, over the brightest value

    @property
    def ratio(self) -> float:
        """How many times longer tracing takes."""
        return self.traced_ms / max(self.cached_ms, 1e-9)

    def sentence(self) -> str:
        """The row in words."""
        return (
            f"Relit at {self.side_px} pixels with {self.lights} lights: {self.cached_ms:.2f} ms a "
            f"picture from a cache of {self.megabytes:.0f} MB, {self.traced_ms:.0f} ms traced "
            f"again: {self.ratio:.0f}x; they differ by at most {100 * self.difference:.2f} % of "
            "the brightest."
        )


def bench_relighting(out: Path, track: Track, sides_px: Sequence[int] = SIDES_PX) -> list[str]:
    """Measure the fit of ``track``, write relighting.csv into ``out``, and return the rows in
    words.
    """
    rows = measure_relighting(track.forward, track.snapshots[-1].state, track.stage, sides_px)
    with (
        atomic_file(out / RELIGHTING_CSV) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream)
        writer.writerow([*(field.name for field in fields(Relighting)), "ratio"])
        writer.writerows(
            [*(f"{value:.6g}" for value in asdict(row).values()), f"{row.ratio:.6g}"]
            for row in rows
        )
    return [row.sentence() for row in rows]


def measure_relighting(
    forward: ForwardModel, state: State, stage: LightStage, sides_px: Sequence[int] = SIDES_PX
) -> list[Relighting]:
    """A row for each size of the picture; both pictures have the samples that the fit's own picture
    has.
    """
    atlas = Atlas.build(forward.geometry, TEXTURE_SIZE)
    textures = Textures(np.exp(atlas.bake(forward.log_albedo(state))), state.specular)
    random = np.random.default_rng(0)
    rows = []
    for side in sides_px:
        camera = state.camera.scaled(side / max(state.camera.width, state.camera.height))
        sized = replace(state, camera=camera)
        cache = render_picture(forward, sized, stage, textures, by_light=True).relight_cache("")
        assert cache is not None  # it was asked for
        radiances = random.uniform(0.1, 10.0, (REPEATS, len(stage), 3))
        seconds = []
        for radiance in radiances:
            started = time.perf_counter()
            relit = cache.relight(radiance)
            seconds.append(time.perf_counter() - started)
        started = time.perf_counter()
        traced = render_picture(forward, sized, stage.with_radiance(radiances[-1]), textures).color
        traced_ms = 1e3 * (time.perf_counter() - started)
        brightest = max(float(traced.max()), 1e-12)
        rows.append(
            Relighting(
                side,
                len(cache.pixels),
                len(cache),
                2e-6 * cache.images.size,
                1e3 * float(np.median(seconds)),
                traced_ms,
                float(np.abs(relit - traced).max()) / brightest,
            )
        )
    return rows
