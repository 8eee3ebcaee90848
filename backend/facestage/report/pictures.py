"""The photo against the fit, the landmarks, and the textures as pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.certainty import nice_limit
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.color import srgb_to_linear
from facestage.contract.result import BY_SYMMETRY, SEEN
from facestage.report.color import (
    MAX_SIDE,
    clean,
    exposure,
    luminance,
    shrink,
    shrink_factor,
    to_image,
    to_srgb8,
)
from facestage.report.figure import DARK, Canvas
from facestage.report.plotting import load_matplotlib
from facestage.report.report_data import ReportData

PANEL_WIDTH, PANEL_HEIGHT = 480, 640
MARGIN, GAP = 20, 14
UNRENDERED_DIM = 0.25  # brightness of the photo where nothing was rendered
CROP_MARGIN = 0.12  # of the face's longer side
COMPARISON_MARGIN = 0.4
PHOTO_FILTER = "bicubic"
GIVEN_COLOR, FITTED_COLOR = "#5ad1ff", "#ffb454"


@dataclass(frozen=True)
class View:
    """The photo and the fit at the size and exposure in which they are shown; (h, w, 3) linear."""

    photo: np.ndarray
    render: np.ndarray  # premultiplied by alpha
    alpha: np.ndarray  # (h, w) share of the pixel that the rendered head covers
    coverage: np.ndarray  # (h, w) bool
    scale: float  # view pixels per photo pixel

    @classmethod
    def of(cls, data: ReportData) -> View:
        """Shrink and expose what ``data`` holds; pixels that are not finite count as not fitted."""
        factor = exposure(data.photo)
        usable = data.coverage & _finite_pixels(data.photo) & _finite_pixels(data.render)
        return cls(
            factor * shrink(data.photo),
            factor * shrink(data.render),
            np.minimum(shrink(data.alpha), 1.0),
            shrink(usable) > 0.5,
            shrink_factor(data.photo.shape),
        )

    def composite(self, dim: float = 1.0) -> np.ndarray:
        """(h, w, 3) the render over the photo times ``dim``.

        Premultiplied "over", Porter and Duff 1984, table 1: at the head's outline a pixel holds as
        much photo as the head leaves of it.
        """
        return self.render + (1.0 - self.alpha[..., None]) * (dim * self.photo)

    def difference(self) -> np.ma.MaskedArray:
        """(h, w) masked: luminance of the fit minus the photo's, both clipped to what a screen
        shows.
        """
        signed = luminance(np.clip(self.render, 0, 1)) - luminance(np.clip(self.photo, 0, 1))
        return np.ma.masked_array(signed, mask=~self.coverage)

    def crop(
        self, points: np.ndarray | None = None, margin: float = CROP_MARGIN
    ) -> tuple[slice, slice]:
        """Rows and columns around the fitted face and ``points`` (m, 2), with a margin; all if
        neither is there.
        """
        height, width = self.coverage.shape
        rows, columns = np.nonzero(self.coverage)
        spots = np.stack([columns, rows], axis=1).astype(float)
        if points is not None:
            spots = np.concatenate([spots, points])
        spots = spots[np.isfinite(spots).all(1)]
        if not len(spots):
            return slice(0, height), slice(0, width)
        low, high = spots.min(0), spots.max(0) + 1
        border = margin * float((high - low).max())
        limit = np.array([width, height])
        low = np.clip(np.floor(low - border), 0, limit - 1).astype(int)
        high = np.maximum(np.clip(np.ceil(high + border), 0, limit).astype(int), low + 1)
        return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _finite_pixels(linear: np.ndarray) -> np.ndarray:
    """(h, w) bool, true where no channel is NaN or infinite; several times faster than
    ``isfinite().all(-1)``.
    """
    finite = np.isfinite(linear)
    return finite[..., 0] & finite[..., 1] & finite[..., 2]


def save_linear(path: Path, linear: np.ndarray) -> None:
    """Write linear values (h, w) or (h, w, 3) as an sRGB PNG."""
    with atomic_file(path) as temporary:
        to_image(linear).save(temporary, format="PNG", compress_level=4)


def draw_faces(folder: Path, view: View) -> None:
    """face.png, the fit in its place in the photo, and face_photo.png, the same crop of the
    photo.
    """
    crop = view.crop()
    save_linear(folder / "face.png", view.composite()[crop])
    save_linear(folder / "face_photo.png", view.photo[crop])


def draw_comparison(path: Path, view: View) -> None:
    """Photo, fit and their difference; the color bar says how much too bright or dark the fit
    is.
    """
    crop = view.crop(margin=COMPARISON_MARGIN)
    height, width = view.photo[crop].shape[:2]
    factor = min(PANEL_WIDTH / width, PANEL_HEIGHT / height)
    panel_height = max(height * factor, 24.0)
    panel_width = max(width * factor, 170.0)
    canvas = Canvas(2 * MARGIN + 3 * panel_width + 2 * GAP, 44 + panel_height + 78, DARK)
    dimmed = view.composite(UNRENDERED_DIM)
    difference = view.difference()[crop]
    limit = difference_limit(difference)
    left = [MARGIN + column * (panel_width + GAP) for column in range(3)]
    pictures = (("Photo", view.photo[crop]), ("Fit", dimmed[crop]))
    for x, (title, picture) in zip(left, pictures, strict=False):
        canvas.text(x, 28, title, 12, weight="bold")
        canvas.picture(
            x, 44, panel_width, panel_height, to_srgb8(picture), interpolation=PHOTO_FILTER
        )
    canvas.text(left[2], 28, "Difference", 12, weight="bold")
    axes, artist = canvas.picture(
        left[2],
        44,
        panel_width,
        panel_height,
        difference,
        cmap=_difference_map(),
        vmin=-limit,
        vmax=limit,
    )
    axes.set_facecolor("#0e0f12")
    bar = canvas.color_bar(
        left[2], 44 + panel_height + 18, panel_width, 10, artist, [-limit, 0, limit]
    )
    labels = bar.ax.get_xticklabels()
    labels[0].set_ha("left")
    labels[-1].set_ha("right")
    below = 44 + panel_height + 66
    canvas.text(
        left[2] + panel_width / 2, below, "fit − photo, luminance", 9.5, DARK.muted, ha="center"
    )
    canvas.save(path)


def difference_limit(difference: np.ndarray) -> float:
    """End of the color bar: nearly all differences (99 %) lie within it."""
    values = np.abs(np.ma.compressed(np.ma.asarray(difference)))
    return nice_limit(float(np.percentile(values, 99)) if values.size else 0.0, 0.01)


def _difference_map() -> object:
    """Too dark blue, right nearly black, too bright red: zero is quiet on a dark page."""
    load_matplotlib()
    from matplotlib.colors import LinearSegmentedColormap

    colors = ["#9fd8ff", "#3d8fe0", "#1c4a80", "#23252b", "#8a3326", "#e8693f", "#ffd9a8"]
    return LinearSegmentedColormap.from_list("difference", colors, N=255)


def draw_landmarks(path: Path, view: View, data: ReportData) -> None:
    """Given landmarks (rings) and fitted ones (dots) on the photo, a line from one to the other."""
    load_matplotlib()
    from matplotlib.collections import LineCollection

    given, fitted = data.landmarks * view.scale, data.projected * view.scale
    known = np.isfinite(given).all(1) & np.isfinite(fitted).all(1)
    seen, hidden = known & data.visible, known & ~data.visible
    rows, columns = view.crop(given[seen])
    picture = to_srgb8(view.photo[rows, columns])
    height, width = picture.shape[:2]
    factor = min(900 / width, 900 / height)
    panel_width, panel_height = max(width * factor, 420.0), max(height * factor, 60.0)
    canvas = Canvas(panel_width, panel_height + 44, DARK)
    extent = (columns.start, columns.stop, rows.stop, rows.start)
    axes, _ = canvas.picture(
        0,
        0,
        panel_width,
        panel_height,
        picture,
        extent=extent,
        alpha=0.8,
        interpolation=PHOTO_FILTER,
    )
    size = 70.0 if len(given) < 120 else 16.0
    for chosen, opacity in ((hidden, 0.35), (seen, 1.0)):
        pairs = np.stack([given[chosen], fitted[chosen]], axis=1)
        lines = LineCollection(list(pairs), colors="white", linewidths=1.0, alpha=0.8 * opacity)
        axes.add_collection(lines, autolim=False)
        axes.scatter(
            *given[chosen].T,
            s=size,
            facecolors="none",
            edgecolors=GIVEN_COLOR,
            lw=1.6,
            alpha=opacity,
        )
        axes.scatter(*fitted[chosen].T, s=0.25 * size, color=FITTED_COLOR, alpha=opacity, lw=0)
    axes.set_xlim(columns.start, columns.stop)
    axes.set_ylim(rows.stop, rows.start)
    _landmark_legend(canvas, panel_height + 27, landmark_distances(data))
    canvas.save(path)


def _landmark_legend(canvas: Canvas, y: float, distances: np.ndarray) -> None:
    canvas.text(20, y, "○ given", 11, GIVEN_COLOR)
    canvas.text(100, y, "● fitted", 11, FITTED_COLOR)
    if distances.size:
        text = f"median {np.median(distances):.2f} px, largest {distances.max():.2f} px"
        canvas.text(canvas.width - 20, y, text, 11, canvas.theme.muted, ha="right")


def landmark_distances(data: ReportData) -> np.ndarray:
    """(v,) pixels of the photo between given and fitted, of the visible landmarks with finite
    places.
    """
    distances = np.linalg.norm(data.landmarks - data.projected, axis=1)
    return distances[data.visible & np.isfinite(distances)]


def draw_colors(path: Path, values: np.ndarray, coverage: np.ndarray | None) -> None:
    """A map (S, S, 3) over the UV square; texels of which the photo says nothing are faded.

    ``coverage`` (S, S, 3) uint8 as of CONVENTIONS.md.
    """
    values = shrink(values)
    if coverage is not None:
        values = values * (0.3 + 0.7 * shrink(coverage[..., 0] > 0)[..., None])
    save_linear(path, values)


def draw_map(path: Path, values: np.ndarray, signed: bool = False) -> None:
    """A map (s, s) over the UV square, grey, with its scale from 0, or where ``signed`` from as far
    below, to a round number.
    """
    values = np.nan_to_num(values) if signed else clean(values)
    limit = nice_limit(float(np.abs(values).max()), 0.01)
    least = -limit if signed else 0.0
    canvas = Canvas(640, 700, DARK)
    _, artist = canvas.picture(
        0, 0, 640, 640, values, cmap="gray", vmin=least, vmax=limit, interpolation="bilinear"
    )
    bar = canvas.color_bar(20, 656, 600, 10, artist, [least, (least + limit) / 2, limit])
    labels = bar.ax.get_xticklabels()
    labels[0].set_ha("left")
    labels[-1].set_ha("right")
    canvas.save(path)


def draw_normals(path: Path, values: np.ndarray) -> None:
    """A normal map (s, s, 3), 0 to 1, over the UV square: its numbers are no light."""
    save_linear(path, srgb_to_linear(shrink(values)))


def draw_coverage(path: Path, coverage: np.ndarray) -> None:
    """Where the albedo's texels are from, by color; ``coverage`` (S, S, 3) uint8 as of
    CONVENTIONS.md.
    """
    colors = (
        ("the photo", SEEN, "#f2c48d"),
        ("its mirror image", BY_SYMMETRY, "#5b9bd5"),
        ("the model", 0, "#2b2e36"),
    )
    step = -(-len(coverage) // MAX_SIDE)
    coverage = coverage[step // 2 :: step, step // 2 :: step]
    picture = np.zeros((*coverage.shape[:2], 3), np.uint8)
    canvas = Canvas(640, 700, DARK)
    left = 20.0
    for words, label, color in colors:
        picture[coverage[..., 0] == label] = [int(color[at : at + 2], 16) for at in (1, 3, 5)]
        canvas.text(left, 675, "■", 14, color)
        canvas.text(left + 20, 675, words, 11)
        left += 200
    canvas.picture(0, 0, 640, 640, picture, interpolation="nearest")
    canvas.save(path)
