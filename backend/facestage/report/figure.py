"""Matplotlib without pyplot: figures laid out in pixels, in a light or a dark theme."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.files.atomic import atomic_file
from facestage.report.plotting import load_matplotlib

DPI = 100
# Of zlib: a level more is half as slow again, and a tenth smaller.
COMPRESS_LEVEL = 1


@dataclass(frozen=True)
class Theme:
    """Colors of a figure; the same values as the page's style sheet."""

    background: str
    text: str
    muted: str
    grid: str
    band: str
    series: tuple[str, str]


# Charts are drawn on white, which the page inverts where dark is preferred; pictures look best on
# dark.
LIGHT = Theme("#ffffff", "#1b1d22", "#6a6f7a", "#e4e6ea", "#f3f4f6", ("#2563a8", "#b4560f"))
DARK = Theme("#17191e", "#eceef2", "#9aa0ac", "#2c3038", "#1f2228", ("#6fb1f5", "#f0a35e"))


class Canvas:
    """A figure of ``width`` x ``height`` pixels whose axes are placed in pixels from the top
    left.
    """

    def __init__(self, width: float, height: float, theme: Theme) -> None:
        load_matplotlib()
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.width, self.height, self.theme = max(1, round(width)), max(1, round(height)), theme
        size = (self.width / DPI, self.height / DPI)
        self.figure: Any = Figure(figsize=size, dpi=DPI, facecolor=theme.background)
        FigureCanvasAgg(self.figure)

    def axes(self, left: float, top: float, width: float, height: float) -> Any:
        """Plain axes in a pixel rectangle, with the theme's colors."""
        bottom = self.height - top - height
        rectangle = (
            left / self.width,
            bottom / self.height,
            width / self.width,
            height / self.height,
        )
        axes = self.figure.add_axes(rectangle, facecolor=self.theme.background)
        axes.tick_params(colors=self.theme.muted, labelsize=10, length=0, which="both")
        for spine in axes.spines.values():
            spine.set_visible(False)
        return axes

    def picture(
        self, left: float, top: float, width: float, height: float, image: Any, **options: Any
    ) -> Any:
        """Axes that show ``image`` (h, w[, 3]), as large as fits in the rectangle; returns axes and
        artist.
        """
        axes = self.axes(left, top, width, height)
        artist = axes.imshow(image, **options)
        axes.set_xticks([])
        axes.set_yticks([])
        return axes, artist

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size: float = 11,
        color: str | None = None,
        **options: Any,
    ) -> None:
        """A line of text whose anchor lies at pixel (x, y) from the top left."""
        self.figure.text(
            x / self.width,
            1.0 - y / self.height,
            text,
            fontsize=size,
            color=color or self.theme.text,
            parse_math=False,
            **options,
        )

    def color_bar(
        self, left: float, top: float, width: float, height: float, artist: Any, ticks: list[float]
    ) -> Any:
        """A horizontal color bar of ``artist`` in a pixel rectangle."""
        axes = self.axes(left, top, width, height)
        bar = self.figure.colorbar(artist, cax=axes, orientation="horizontal", ticks=ticks)
        bar.outline.set_visible(False)
        bar.ax.minorticks_off()
        bar.ax.tick_params(colors=self.theme.muted, labelsize=10, length=0)
        bar.ax.set_xticklabels([f"{tick:g}".replace("-", "−") for tick in ticks])
        return bar

    def save(self, path: Path) -> None:
        """Write the figure as a PNG without the opacity that a figure has."""
        from PIL import Image

        self.figure.canvas.draw()
        picture = Image.fromarray(np.asarray(self.figure.canvas.buffer_rgba())[..., :3])
        with atomic_file(path) as temporary:
            picture.save(temporary, format="PNG", compress_level=COMPRESS_LEVEL)
