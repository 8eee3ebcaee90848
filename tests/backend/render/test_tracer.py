"""The mesh is where it was last put, however often."""

from __future__ import annotations

import numpy as np

from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer

TRIANGLE = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
DOWN = np.array([[0.2, 0.2, -1.0], [0.8, 0.8, -1.0]])


def hit(tracer: RayTracer) -> list[bool]:
    rays = DOWN / np.linalg.norm(DOWN, axis=1, keepdims=True)
    return (tracer.first_hits(np.zeros(3), rays).triangle >= 0).tolist()


def test_what_was_moved_there_and_back_is_hit_again():
    start_renderer("cpu")
    tracer = RayTracer(np.array([[0, 1, 2]]), 3)
    for _ in range(2):
        tracer.update(TRIANGLE)
        tracer.update(TRIANGLE)
        assert hit(tracer) == [True, False]
        place = TRIANGLE + np.array([0.5, 0.5, 0.0])
        tracer.update(place)
        assert hit(tracer) == [False, True]
        place -= 9.0  # whoever moved it goes on with the array
        assert hit(tracer) == [False, True]
