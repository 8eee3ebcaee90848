from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from facestage.report import write_preview


def test_the_preview_shows_photo_and_fit_side_by_side(tmp_path: Path) -> None:
    path = tmp_path / "preview.png"
    write_preview(path, np.full((6, 4, 3), 0.18), np.full((6, 4, 3), 0.5))
    with Image.open(path) as image:
        pixels = np.asarray(image)
    assert pixels.shape == (6, 8, 3)
    assert (pixels[:, :4] == 118).all() and (pixels[:, 4:] == 188).all()


def test_a_large_preview_is_shrunk(tmp_path: Path) -> None:
    path = tmp_path / "preview.png"
    write_preview(
        path,
        np.full((3000, 1500, 3), 0.5, np.float32),
        np.full((3000, 1500, 3), np.nan, np.float32),
    )
    with Image.open(path) as image:
        assert max(image.size) <= 400
        pixels = np.asarray(image)
    assert (pixels[:, : pixels.shape[1] // 2] == 188).all() and (
        pixels[:, pixels.shape[1] // 2 :] == 0
    ).all()


def test_a_failed_preview_leaves_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "preview.png"
    picture = np.full((4, 4, 3), 0.5)
    write_preview(path, picture, picture)
    before = path.read_bytes()

    def fail(self: Image.Image, target: Path, **_: object) -> None:
        Path(target).write_bytes(b"half a picture")
        raise OSError("disk full")

    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(OSError, match="disk full"):
        write_preview(path, picture, picture)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["preview.png"]
