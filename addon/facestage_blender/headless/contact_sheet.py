"""One picture that shows all others with captions.

Only the demo uses it: Blender has no matplotlib.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

COLUMNS = 4
CELL_INCHES, DPI = 3.0, 130
PAPER, INK = "#1b1b1d", "#e8e8ea"


def contact_sheet(pictures: dict[str, np.ndarray], path: Path, columns: int = COLUMNS) -> None:
    """Write captioned sRGB pictures (h, w, 3), 0..1, as one PNG; a wide one takes two cells."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cells: list[tuple[str, np.ndarray, int, int, int]] = []
    row = column = 0
    for caption, pixels in pictures.items():
        span = 2 if pixels.shape[1] > 1.5 * pixels.shape[0] else 1
        if column + span > columns:
            row, column = row + 1, 0
        cells.append((caption, pixels, row, column, span))
        column += span
    rows = row + 1
    figure = Figure(
        figsize=(columns * CELL_INCHES, rows * (CELL_INCHES + 0.3)), dpi=DPI, facecolor=PAPER
    )
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        rows, columns, left=0.01, right=0.99, bottom=0.01, top=0.95, wspace=0.03, hspace=0.12
    )
    for caption, pixels, row, column, span in cells:
        axes = figure.add_subplot(grid[row, column : column + span])
        axes.imshow(np.clip(pixels, 0, 1), interpolation="lanczos")
        axes.set_title(caption, color=INK, fontsize=11, pad=5)
        axes.set_axis_off()
    figure.savefig(path, facecolor=PAPER)
