"""Films: folders in natural order, videos with their own times, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.images.film import Film
from facestage.images.image_io import write_png
from facestage.images.opencv import opencv


def picture(value: int, width: int = 48, height: int = 32) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


def folder_of(folder: Path, names: list[str]) -> Path:
    for value, name in enumerate(names):
        write_png(folder / name, picture(20 * value + 20))
    return folder


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path: Path):
    folder_of(tmp_path, ["shot10.png", "shot9.png", "shot12.png", "Shot8.png"])
    (tmp_path / "notes.txt").write_text("not a picture")
    film = Film(tmp_path, 25.0)
    frames = list(film.frames())
    assert [frame.number for frame in frames] == [8, 9, 10, 12]
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    np.testing.assert_allclose([frame.time for frame in frames], [0, 0.04, 0.08, 0.16])
    assert film.count == 4 and frames[0].name == "Shot8.png"
    later = list(film.frames(2))
    assert [frame.number for frame in later] == [10, 12]
    np.testing.assert_array_equal(later[0].photograph.color, frames[2].photograph.color)


def test_names_without_numbers_are_counted(tmp_path: Path):
    folder_of(tmp_path, ["a.png", "b.png", "c.png"])
    assert [frame.number for frame in Film(tmp_path).frames()] == [1, 2, 3]


def test_a_frame_of_another_size_is_named(tmp_path: Path):
    folder_of(tmp_path, ["1.png", "2.png", "3.png"])
    write_png(tmp_path / "2.png", picture(9, width=40))
    with pytest.raises(InputError, match=r"'2\.png' .* has 40 x 32 pixels"):
        list(Film(tmp_path).frames())


def video_of(path: Path, count: int) -> Path:
    cv2 = opencv()
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (48, 32))
    for value in range(count):
        writer.write(picture(20 * value + 20))
    writer.release()
    return path


def test_a_video_has_its_own_times_and_the_pixels_of_its_frames(tmp_path: Path):
    film = Film(video_of(tmp_path / "take.avi", 6))
    frames = list(film.frames())
    assert film.rate == pytest.approx(30.0) and film.count is None
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(6) / 30, atol=1e-3)
    means = [float(frame.photograph.color.mean()) for frame in frames]
    assert means == sorted(means) and frames[0].photograph.size == (48, 32)
    later = list(film.frames(4))
    assert [frame.index for frame in later] == [4, 5]
    np.testing.assert_array_equal(later[0].photograph.color, frames[4].photograph.color)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "nothing.mp4", "There is no video or folder"),
        (lambda folder: folder, "holds 0 pictures"),
    ],
)
def test_what_is_no_film_is_refused(make, words: str, tmp_path: Path):
    with pytest.raises(InputError, match=words):
        Film(make(tmp_path))


def test_a_file_that_is_no_video_and_a_rate_of_one_are_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    text = tmp_path / "take.mp4"
    text.write_bytes(b"no video at all")
    with pytest.raises(InputError, match="not a video"):
        Film(text)
    with pytest.raises(InputError, match="has its own times"):
        Film(text, 24.0)
    with pytest.raises(InputError, match="frame rate is 0"):
        Film(text, 0.0)
    assert capfd.readouterr().err == ""  # of the decoder, which says so, too


def test_a_part_of_a_film_counts_from_its_first_frame(tmp_path: Path):
    (tmp_path / "frames").mkdir()
    folder = Film(folder_of(tmp_path / "frames", [f"{number}.png" for number in range(5, 11)]))
    for film in (folder, Film(video_of(tmp_path / "take.avi", 6))):
        part, whole = film.part(2, 5), list(film.frames())
        assert part.count == 3 and part.rate == film.rate
        frames = list(part.frames())
        assert [frame.index for frame in frames] == [0, 1, 2]
        for frame, other in zip(frames, whole[2:5], strict=True):
            assert (frame.number, frame.time, frame.name) == (other.number, other.time, other.name)
            np.testing.assert_array_equal(frame.photograph.color, other.photograph.color)
            assert part.picture(frame.index) == film.picture(other.index)
        assert [frame.number for frame in part.frames(1)] == [other.number for other in whole[3:5]]
    assert len(list(folder.frames())) == 6
