"""The built-in head."""

from __future__ import annotations

import pytest

from facestage.contract.face_model import FaceModel
from facestage.models.registry import load_model


@pytest.fixture(scope="module")
def model() -> FaceModel:
    """The default head: what is worn needs landmarks where a face has them."""
    return load_model("default")
