"""The demo: its crop, its contact sheet, its landmarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.landmarks import Landmarks


def test_crop_is_a_square_inside_the_picture() -> None:
    from facestage_blender.headless import demo

    crop = demo.head_crop(Landmarks.read(demo.SHIPPED_LANDMARKS), Camera.default(512, 512))
    left, top, right, bottom = crop.box
    assert right - left == bottom - top
    assert left >= 0
    assert top >= 0
    assert right <= 512
    assert bottom <= 512
    points = Landmarks.read(demo.SHIPPED_LANDMARKS).points
    assert (points > [left, top]).all()
    assert (points < [right, bottom]).all()


def test_contact_sheet_shows_every_picture(tmp_path: Path) -> None:
    import cv2

    from facestage_blender.headless.contact_sheet import contact_sheet

    colors = np.eye(3)
    pictures = {f"picture {k}": np.full((20, 20 + 30 * (k == 2), 3), colors[k]) for k in range(3)}
    contact_sheet(pictures, tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))[..., ::-1] / 255.0
    for color in colors:
        assert (np.abs(sheet - color).max(axis=2) < 0.05).mean() > 0.05


def test_the_demo_detects_or_takes_what_is_shipped(
    stand_in, photo: Path, tmp_path: Path, capfd
) -> None:
    from facestage_blender.headless.demo import SHIPPED_LANDMARKS, astronaut_landmarks

    out = tmp_path / "found.json"
    assert astronaut_landmarks(photo, out, stand_in("works")) == (
        out,
        "found in the photo (478 points)",
    )
    path, origin = astronaut_landmarks(photo, out, stand_in("sees no face"))
    assert (path, origin) == (SHIPPED_LANDMARKS, "from the file that comes with the demo")
    assert "No face was found" in capfd.readouterr().err
