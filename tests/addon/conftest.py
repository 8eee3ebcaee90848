"""A clean scene with the add-on enabled for each test, a small head, and a stand-in for the
backend.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel

HERE = Path(__file__).parent


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave this folder out where Blender is not installed as a module."""
    if collection_path.suffix == ".py" and collection_path.name.startswith("test_"):
        try:
            import bpy  # noqa: F401
        except ImportError:
            return True
    return None


@pytest.fixture(scope="session")
def head() -> FaceModel:
    """An egg with a nose: 3000 vertices, quads and triangles, two parts, four expressions."""
    across, up = 64, 48
    u, v = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0.02, 0.98, up + 1))
    turn, rise = (u - 0.5) * 2 * np.pi, (v - 0.5) * np.pi
    nose = 0.02 * np.exp(-(((u - 0.5) / 0.03) ** 2) - ((v - 0.5) / 0.05) ** 2)
    grid = np.stack(
        [
            0.075 * np.sin(turn) * np.cos(rise),
            0.12 * np.sin(rise),
            0.095 * np.cos(turn) * np.cos(rise) + nose - 0.06,
        ],
        -1,
    )
    vertices = grid[:, :across].reshape(-1, 3)
    i, j = np.arange(across)[None], np.arange(up)[:, None]
    after = (i + 1) % across
    quads = np.stack(
        np.broadcast_arrays(
            j * across + i, j * across + after, (j + 1) * across + after, (j + 1) * across + i
        ),
        -1,
    )
    uv_row = across + 1
    quad_uvs = np.stack(
        np.broadcast_arrays(
            j * uv_row + i, j * uv_row + i + 1, (j + 1) * uv_row + i + 1, (j + 1) * uv_row + i
        ),
        -1,
    )
    quads, quad_uvs = (
        quads.reshape(-1, 4).astype(np.int32),
        quad_uvs.reshape(-1, 4).astype(np.int32),
    )
    quads[-10:, 3] = quad_uvs[-10:, 3] = -1  # a few triangles
    rng = np.random.default_rng(0)
    stretch = np.einsum("kij,nj->kni", rng.normal(size=(6, 3, 3)) * 0.02, vertices)
    front = vertices[:, 2] > 0
    jaw = np.zeros((4, len(vertices), 3))
    jaw[0, :, 1] = -0.02 * front * np.exp(-(((vertices[:, 1] + 0.05) / 0.02) ** 2))
    jaw[1, :, 2] = 0.01 * front * np.exp(-(((vertices[:, 1] - 0.05) / 0.02) ** 2))
    jaw[2:] = 0.3 * jaw[:2]
    landmark_vertices = np.argsort(-vertices[:, 2])[: 68 * 6 : 6]
    landmarks = np.zeros((68, 6), np.float32)
    landmarks[:, :3], landmarks[:, 3] = landmark_vertices[:, None], 1
    return FaceModel(
        name="egg",
        license="CC0-1.0",
        source="made for the tests",
        vertices=vertices.astype(np.float32),
        polygons=quads,
        polygon_uvs=quad_uvs,
        polygon_part=(np.arange(len(quads)) > len(quads) - 200).astype(np.uint8),
        uvs=np.stack([u, v], -1).reshape(-1, 2).astype(np.float32),
        identity_names=tuple(f"mode_{k}" for k in range(6)),
        identity_basis=stretch.astype(np.float32),
        expression_names=("jawOpen", "browUp", "mode_0", "blink"),
        expression_basis=jaw.astype(np.float32),
        albedo_mean=np.clip(
            np.array([0.45, 0.28, 0.2]) + 0.1 * np.sin(60 * vertices), 0.02, 0.9
        ).astype(np.float32),
        albedo_basis=(0.05 * rng.normal(size=(3, len(vertices), 3))).astype(np.float32),
        landmarks={"ibug68": landmarks},
        regions={"nose": landmark_vertices[:20].astype(np.int32)},
    )


@contextmanager
def addon_enabled() -> Iterator[Any]:
    """An empty scene with the add-on enabled; disabled afterwards, and the next one empties it."""
    import bpy  # first, because it is what makes the other importable

    import addon_utils  # isort: skip

    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert addon_utils.enable("facestage_blender", default_set=True) is not None
    yield bpy.context.scene
    addon_utils.disable("facestage_blender", default_set=True)


@pytest.fixture
def scene() -> Iterator[object]:
    with addon_enabled() as scene:
        yield scene


@pytest.fixture(scope="session")
def empty_scene() -> Callable[[], AbstractContextManager[Any]]:
    """For fixtures that several tests share: ``with empty_scene() as scene``."""
    return addon_enabled


@pytest.fixture(scope="session")
def head_file(head: FaceModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small head as the backend would export it."""
    path = tmp_path_factory.mktemp("model") / "head.npz"
    head.save(path)
    return path


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, head_file: Path) -> Callable[[str], list[str]]:
    """Make a small script the backend; call with its mood ("works", "refuses", "hangs", ...)."""

    def choose(mood: str) -> list[str]:
        command = [sys.executable, str(HERE / "stand_in_backend.py")]
        monkeypatch.setenv("FACESTAGE_BACKEND", shlex.join(command))
        monkeypatch.setenv("STAND_IN_MOOD", mood)
        monkeypatch.setenv("STAND_IN_MODEL", str(head_file))
        return command

    return choose


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A grey 96 x 80 photo."""
    import cv2

    path = tmp_path / "photo.png"
    assert cv2.imwrite(str(path), np.full((80, 96, 3), 128, np.uint8))
    return path


@pytest.fixture
def landmark_file(tmp_path: Path) -> Path:
    """68 landmarks somewhere on the photo."""
    import json

    path = tmp_path / "landmarks.json"
    points = np.random.default_rng(1).uniform(20, 60, (68, 2))
    path.write_text(json.dumps({"scheme": "ibug68", "points": points.tolist()}), encoding="utf-8")
    return path
