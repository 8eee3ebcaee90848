"""Photographs of a scan from the command line: what they hold, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.bench.cases import Case
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import write_json
from facestage.contract.landmarks import Landmarks
from facestage.contract.scan import Scan
from reference.known import known

SIZE = 48


@pytest.fixture
def egg(head: FaceModel, tmp_path: Path) -> Path:
    """The small head as a scan in centimetres, without UVs."""
    path = tmp_path / "egg.obj"
    lines = ["v {:.5f} {:.5f} {:.5f}".format(*point) for point in 100.0 * head.vertices]
    lines += ["f " + " ".join(str(k + 1) for k in face if k >= 0) for face in head.polygons]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def order(egg: Path, out: Path, *more: str) -> list[str]:
    quick = ["--size", str(SIZE), "--samples", "1"]
    return ["--scan", str(egg), "--scan-units", "cm", "--out", str(out), *quick, *more]


def test_photos_show_the_scan_where_it_is(scene, head: FaceModel, egg: Path, tmp_path: Path):
    from facestage_blender.headless.cases import main
    from facestage_blender.pictures.render import read_pixels

    region = np.flatnonzero(head.vertices[:, 2] > np.quantile(head.vertices[:, 2], 0.7))
    np.save(tmp_path / "face.npy", region)
    poses = ["--scan-yaw", "0", "-25", "--scan-pitch", "0", "10", "--scan-light", "forest@30"]
    options = order(egg, tmp_path / "out", "--face-region", str(tmp_path / "face.npy"), *poses)
    assert main(options) == 0
    folders = sorted((tmp_path / "out").iterdir())
    assert [folder.name for folder in folders] == ["1-forest", "2-forest"]
    normal = []
    for folder in folders:
        job = Case("scan", folder, "default").job()
        camera, scan = known(job.camera), Scan.load(known(job.truth))
        assert job.landmarks is None and (camera.width, camera.height) == (SIZE, SIZE)
        np.testing.assert_array_equal(scan.face, region)
        photo, linear = read_pixels(folder / "photo.png"), read_pixels(folder / "photo.exr")
        x, y = camera.project(scan.vertices[region]).astype(int).T
        assert linear[y, x, :3].mean() == pytest.approx(0.18, abs=0.001)
        assert 0.2 < photo[y, x, :3].mean() < 0.6
        # Skin, not the wall behind it.
        assert photo[y, x, 0].mean() > 1.1 * photo[y, x, 2].mean()
        # The middle of the face is in the middle of the picture, 90 cm away.
        middle = 0.5 * (scan.vertices[region].min(0) + scan.vertices[region].max(0))
        assert np.linalg.norm(middle - [0, 0, -900]) < 30
        a, b, c = scan.vertices[scan.triangles[0]] - [0, 0, -900]
        normal.append(np.cross(b - a, c - a))
        assert np.ptp(scan.vertices, axis=0)[1] == pytest.approx(240, rel=0.1)
    turned = normal[0] @ normal[1] / np.linalg.norm(normal[0]) / np.linalg.norm(normal[1])
    assert turned < np.cos(np.radians(5)), "the second head is turned"


def test_the_face_is_found_from_the_front(
    scene, head: FaceModel, egg: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from facestage_blender.headless import pipeline
    from facestage_blender.headless.cases import main

    asked: list[list[str]] = []

    def detect(command: list[str], _tell: object) -> None:
        asked.append(command)
        angle = np.linspace(0, 2 * np.pi, 68, endpoint=False)
        points = 128 + 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        out = Path(command[command.index("--out") + 1])
        write_json(out, Landmarks("ibug68", points, np.ones(68, bool)).to_json())

    monkeypatch.setattr(pipeline, "run_backend", detect)
    out = tmp_path / "out"
    assert main(order(egg, out, "--scan-yaw", "0", "--scan-light", "studio")) == 0
    assert len(asked) == 1 and "detect" in asked[0]
    scan = Scan.load(out / "1-studio" / "scan.npz")
    face = scan.vertices[scan.face] - scan.vertices.mean(axis=0)
    # Thirty pixels of the frontal picture, 900 mm away by a lens of 2.2 sides.
    radius = 30 * 900 / (2.2 * 256)
    assert 0.8 * radius < np.linalg.norm(face[:, :2], axis=1).max() < 1.1 * radius
    assert face[:, 2].min() > 0


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--person", "3"], "leave out --person"),
        (["--scan-yaw", "5", "-80"], "turned by -80 degrees"),
        (["--scan-pitch", "nan"], "turned by nan degrees"),
        (["--scan-light", "moon"], "no light 'moon'"),
        (["--scan-color", "color.png"], "no texture coordinates"),
        (["--scan-up=-Z"], "cannot look along +Z"),
        (["--scan-units", "m"], "mm large"),
        (["--face-region", "none.npy"], "none.npy' does not exist"),
        (["--size", "0"], "Photos of 0 pixels"),
    ],
)
def test_wrong_orders_are_refused_in_one_sentence(
    scene,
    egg: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    words: str,
):
    from facestage_blender.headless.cases import main

    assert main(order(egg, tmp_path / "out", *more)) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and words in error
    assert not (tmp_path / "out").exists()
