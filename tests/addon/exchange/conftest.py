"""A film, a rig, and a performance that the backend might have found in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.exchange.films import FRAMES, HEIGHT, RATE, WIDTH
from facestage.contract.camera import Camera
from facestage.contract.result import CONVERGED
from facestage.contract.sequence import KEYFRAMES, SEEN, Sequence, SequenceFrame


@pytest.fixture
def film(tmp_path: Path) -> Path:
    """A folder of grey pictures, number 5 and on."""
    import bpy

    folder = tmp_path / "my film"
    folder.mkdir()
    for number in range(5, 5 + FRAMES):
        image = bpy.data.images.new("grey", WIDTH, HEIGHT)
        image.filepath_raw, image.file_format = str(folder / f"{number:04}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
    return folder


@pytest.fixture
def ready(scene, stand_in, film: Path, tmp_path: Path):
    import bpy

    stand_in("works")
    scene.facestage.output, scene.facestage.light_count = str(tmp_path / "work"), 4
    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(film / "0005.png")),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
    ):
        assert answer == {"FINISHED"}
    return scene


@pytest.fixture
def sequence(ready, head, film: Path, tmp_path: Path) -> Sequence:
    """A head that turns twice round while its jaw opens, written as the backend writes it."""
    from addon import stand_in_results
    from facestage_blender.exchange.scene_read import read_job

    folder = tmp_path / "track"
    folder.mkdir()
    job = replace(read_job(ready), camera=Camera.default(WIDTH, HEIGHT))
    job.save(tmp_path / "job")
    stand_in_results.fit_person([tmp_path / "job", tmp_path / "job"], folder / KEYFRAMES)
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    for pose, angle in zip(poses, np.linspace(0, 4 * np.pi, FRAMES), strict=True):
        cos, sin = np.cos(angle), np.sin(angle)
        pose[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
        pose[:3, 3] = (0.1 * sin, 0.02, -1.1 + 0.1 * cos)
    result = Sequence(
        CONVERGED,
        "All is well.",
        str(film),
        "default",
        Camera.default(WIDTH, HEIGHT),
        RATE,
        tuple(
            SequenceFrame(5 + place, place / RATE, f"{5 + place:04}.png", SEEN)
            for place in range(FRAMES)
        ),
        (5, 9),
        head.identity_names,
        head.expression_names,
        np.zeros(len(head.identity_names)),
        rng.uniform(0, 1, (FRAMES, len(head.expression_names))),
        poses,
        {},
        {},
        {},
        {},
    )
    result.write_into(folder)
    return Sequence.load(folder)
