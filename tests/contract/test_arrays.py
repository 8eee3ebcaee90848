"""The shapes in annotations are checked while the tests run, and cost nothing elsewhere."""

from __future__ import annotations

import subprocess
import sys

import jaxtyping
import numpy as np
import pytest

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage


def test_an_argument_of_another_shape_is_refused():
    camera = Camera.default(40, 30)
    assert camera.project(-np.ones((2, 3))).shape == (2, 2)
    with pytest.raises(jaxtyping.TypeCheckError, match="points"):
        camera.project(-np.ones((2, 4)))
    with pytest.raises(jaxtyping.TypeCheckError, match="points"):
        camera.project(np.ones((2, 3), int))


def test_the_sides_of_one_dataclass_agree():
    Landmarks("ibug68", np.zeros((4, 2)), np.ones(4, bool))
    with pytest.raises(jaxtyping.TypeCheckError, match="visible"):
        Landmarks("ibug68", np.zeros((4, 2)), np.ones(5, bool))


def test_what_a_dataclass_refuses_it_says_itself():
    stage = fibonacci_stage(3)
    with pytest.raises(InputError, match=r"radiance has shape \(4, 3\), expected \(3, 3\)"):
        type(stage)(**(vars(stage) | {"radiance": np.ones((4, 3))}))


def test_the_annotations_are_jaxtypings_here_and_nothing_elsewhere():
    assert Float is jaxtyping.Float
    script = (
        "import sys, typing; from facestage.contract.arrays import Float; assert Float is "
        "typing.Annotated and 'jaxtyping' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)
