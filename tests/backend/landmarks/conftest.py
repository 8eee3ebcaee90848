"""The model that finds faces, and photos to find them in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from facestage.contract.files.color import srgb_to_linear
from facestage.images.image_io import Photograph
from facestage.landmarks.finder import Face, FaceFinder
from facestage.landmarks.model_file import Bundle, find_model, open_model


@pytest.fixture(scope="session")
def bundle() -> Bundle:
    """The landmark model; tests never fetch it."""
    path = find_model()
    if path is None:
        pytest.skip(
            "needs face_landmarker.task; put it in shared/data beside the project or run: "
            "facestage detect"
        )
    return open_model(path)


@pytest.fixture(scope="session")
def finder(bundle: Bundle) -> FaceFinder:
    return FaceFinder(bundle)


@pytest.fixture(scope="session")
def astronaut() -> np.ndarray:
    """(512, 512, 3) uint8 sRGB: a real face, 108 pixels high (NASA, public domain)."""
    import skimage.data

    return np.asarray(skimage.data.astronaut())


@pytest.fixture(scope="session")
def found(finder: FaceFinder, astronaut: np.ndarray) -> Face:
    """The face of the astronaut's photo as it is."""
    faces = finder.find(as_photo(astronaut)).faces
    assert len(faces) == 1
    return faces[0]


@pytest.fixture(scope="session")
def photo_of() -> Callable[[np.ndarray], Photograph]:
    return as_photo


def as_photo(picture: np.ndarray) -> Photograph:
    """A photograph from grey or RGB sRGB values, uint8."""
    rgb = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    color = srgb_to_linear(rgb[..., :3] / 255.0).astype(np.float32)
    return Photograph(color, np.ones(color.shape[:2], bool), np.zeros(color.shape, bool))
