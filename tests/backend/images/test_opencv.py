"""One of OpenCV's packages has all that is needed; with another in its place nothing is read."""

from __future__ import annotations

import sys
import types

import pytest

from facestage.contract.errors import BackendUnavailableError
from facestage.images.opencv import opencv


def test_a_package_without_all_modules_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch):
    assert opencv().ximgproc
    other = types.ModuleType("cv2")
    vars(other).update(__version__="5.0.0", __file__="/somewhere/cv2.so")
    monkeypatch.setitem(sys.modules, "cv2", other)
    with pytest.raises(BackendUnavailableError, match=r"OpenCV 5.0.0 at .* then pip install"):
        opencv()
