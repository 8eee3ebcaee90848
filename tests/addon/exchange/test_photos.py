"""Several photos of one person: listed, shown in turn, fitted together, saved with the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused
from facestage.contract.person import PHOTOS_MAX


@pytest.fixture
def photos(tmp_path: Path) -> list[Path]:
    """Nine grey photos of different sizes."""
    import bpy

    paths = []
    for number in range(1, PHOTOS_MAX + 2):
        image = bpy.data.images.new("grey", 90 + 2 * number, 80)
        paths.append(tmp_path / f"photo {number}.png")
        image.filepath_raw, image.file_format = str(paths[-1]), "PNG"
        image.save()
        bpy.data.images.remove(image)
    return paths


@pytest.fixture
def ready(scene, stand_in, photos: list[Path], tmp_path: Path):
    """A stage and a rig, and three photos of which the second is shown."""
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    scene.facestage.light_count = 5
    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(photos[0])),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
        add(photos[1:3]),
    ):
        assert answer == {"FINISHED"}
    return scene


def add(paths: list[Path]) -> set[str]:
    import bpy

    return bpy.ops.facestage.add_photos(
        directory=str(paths[0].parent), files=[{"name": path.name} for path in paths]
    )


def shown(scene) -> tuple[str, int, int]:
    """The photo's name, and the size of a render."""
    return Path(scene.facestage.photo).name, scene.render.resolution_x, scene.render.resolution_y


def test_the_first_of_the_added_photos_is_shown(ready) -> None:
    assert [Path(photo.photo).name for photo in ready.facestage.photos] == [
        "photo 1.png",
        "photo 2.png",
        "photo 3.png",
    ]
    assert ready.facestage.photo_number == 2
    assert shown(ready) == ("photo 2.png", 94, 80)
    background = ready.camera.data.background_images[0]
    assert background.image.size[:] == (94, 80)


def test_each_photo_keeps_its_landmarks_lens_and_light(
    ready, landmark_file: Path, tmp_path: Path
) -> None:
    import bpy

    settings, camera = ready.facestage, ready.camera.data
    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    camera.lens, camera.shift_x, settings.known_lens = 85.0, 0.1, True
    settings.white_balance_known, settings.white_balance = True, (1.0, 0.5, 0.25)
    settings.face_number = 2
    bpy.ops.facestage.show_photo(number=1)
    assert shown(ready)[0] == "photo 1.png"
    assert not settings.landmarks and not settings.white_balance_known
    assert settings.face_number == 1 and not settings.known_lens
    assert camera.lens == pytest.approx(50) and camera.shift_x == pytest.approx(0)
    bpy.ops.facestage.show_photo(number=2)
    assert Path(settings.landmarks) == landmark_file and settings.landmarks_from == "FILE"
    assert settings.white_balance_known and settings.white_balance[:] == (1.0, 0.5, 0.25)
    assert settings.face_number == 2 and settings.known_lens
    assert camera.lens == pytest.approx(85) and camera.shift_x == pytest.approx(0.1)


def test_landmarks_that_are_being_dragged_are_kept_with_their_photo(ready) -> None:
    import bpy

    from facestage_blender.landmarks.empties import landmark_empties

    assert bpy.ops.facestage.detect_landmarks() == {"FINISHED"}
    before = ready.facestage.landmarks
    landmark_empties(ready)[3].location.x += 0.02
    ready.view_layers[0].update()
    bpy.ops.facestage.show_photo(number=3)
    assert not landmark_empties(ready) and not ready.facestage.landmarks
    bpy.ops.facestage.show_photo(number=2)
    assert ready.facestage.landmarks_from == "EDITED" and ready.facestage.landmarks != before


def test_every_photo_has_a_job_of_its_own(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.exchange.scene_read import read_jobs

    ready.facestage.known_lens, ready.camera.data.lens = True, 85.0
    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.show_photo(number=3)
    one, two, three = read_jobs(ready)
    assert [job.image.name for job in (one, two, three)] == [
        "photo 1.png",
        "photo 2.png",
        "photo 3.png",
    ]
    assert two.landmarks is not None and one.landmarks is None and three.landmarks is None
    assert one.camera is None and three.camera is None
    assert two.camera is not None
    assert two.camera.focal_px == pytest.approx(85 * 94 / 36) and two.camera.width == 94
    for job in (one, three):
        assert job.stage is not None and two.stage is not None
        np.testing.assert_array_equal(job.stage.radiance, two.stage.radiance)


def test_the_fit_gives_each_photo_its_result(ready, tmp_path: Path) -> None:
    import bpy

    from facestage.contract.result import Result
    from facestage_blender.exchange.photos import stored_photos
    from facestage_blender.rig.face_rig import read_weights

    assert bpy.ops.facestage.fit() == {"FINISHED"}
    state, work = bpy.context.window_manager.facestage, tmp_path / "work"
    assert state.verdict == "The stand-in knows them." and not state.doubtful
    assert sorted(path.name for path in work.glob("job*")) == ["job_1", "job_2", "job_3"]
    listed = ready.facestage.photos
    assert [Path(photo.result).name for photo in listed] == ["1-photo", "2-photo", "3-photo"]
    assert [photo.doubtful for photo in listed] == [False, False, True]
    assert "another person" in listed[2].advice
    assert all(photo.landmarks_from == "DETECTED" for photo in stored_photos(ready))

    def expression() -> list[float]:
        return list(read_weights(ready.facestage.rig)[1].values())

    assert expression() == pytest.approx(Result.load(Path(listed[1].result)).expression.tolist())
    assert bpy.ops.facestage.show_photo(number=3) == {"FINISHED"}
    assert ready.facestage.result == listed[2].result
    assert expression() == pytest.approx(Result.load(Path(listed[2].result)).expression.tolist())
    assert bpy.ops.facestage.show_photo(number=1, apply=False) == {"FINISHED"}
    assert expression() == pytest.approx(Result.load(Path(listed[2].result)).expression.tolist())
    assert Path(ready.facestage.result).name == "1-photo"


def test_a_result_that_is_gone_changes_nothing(ready) -> None:
    import shutil

    import bpy

    bpy.ops.facestage.fit()
    shutil.rmtree(ready.facestage.photos[0].result)
    refused(bpy.ops.facestage.show_photo, "1-photo", number=1)
    assert shown(ready)[0] == "photo 2.png" and ready.facestage.photo_number == 2


def test_removing_leaves_the_others_as_they_were(ready) -> None:
    import bpy

    ready.facestage.face_number = 4
    bpy.ops.facestage.remove_photo(number=1)
    assert ready.facestage.photo_number == 1 and shown(ready)[0] == "photo 2.png"
    assert ready.facestage.face_number == 4
    bpy.ops.facestage.remove_photo(number=1)  # the one that is shown
    assert not len(ready.facestage.photos) and shown(ready)[0] == "photo 3.png"
    assert ready.facestage.face_number == 1
    refused(bpy.ops.facestage.remove_photo, "There is no photo 1", number=1)


def test_what_cannot_be_added_is_refused_and_nothing_is(
    ready, photos: list[Path], tmp_path
) -> None:
    import bpy

    wrong = tmp_path / "words.png"
    wrong.write_text("no picture", encoding="utf-8")
    for paths, sentence in (
        ([photos[3], wrong], "holds no picture"),
        ([photos[0]], "there already"),
        (photos[3:], "9 photos are too many"),
    ):
        refused(
            bpy.ops.facestage.add_photos,
            sentence,
            directory=str(tmp_path),
            files=[{"name": path.name} for path in paths],
        )
        assert len(ready.facestage.photos) == 3 and shown(ready)[0] == "photo 2.png"


def test_switching_is_one_undo_step(ready) -> None:
    import bpy

    bpy.ops.facestage.fit(apply=False)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.facestage.show_photo(number=3)
    bpy.ops.ed.undo_push(message="Show Photo")
    assert shown(bpy.context.scene)[0] == "photo 3.png"
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert shown(scene) == ("photo 2.png", 94, 80) and scene.facestage.photo_number == 2


def test_a_moved_project_finds_every_photo(ready, photos: list[Path], tmp_path: Path) -> None:
    import bpy

    bpy.ops.facestage.fit()
    old = tmp_path / "old"
    old.mkdir()
    blend = old / "face.blend"
    for name in [photo.name for photo in photos[:3]] + ["work"]:
        (tmp_path / name).rename(old / name)
    for settings in (ready.facestage, *ready.facestage.photos):
        for name in ("photo", "result", "landmarks"):
            setattr(settings, name, getattr(settings, name).replace(str(tmp_path), str(old)))
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    old.rename(tmp_path / "new")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "new" / "face.blend"))
    scene = bpy.context.scene
    for number in (1, 2, 3):
        assert bpy.ops.facestage.show_photo(number=number) == {"FINISHED"}
        assert shown(scene)[0] == f"photo {number}.png"
