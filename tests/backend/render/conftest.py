"""The renderer, started once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from reference.rendering.meshes import Mesh


@pytest.fixture(scope="session")
def renderer() -> str:
    """The CPU renderer: the same numbers on every machine."""
    from facestage.render.variant import start_renderer

    return start_renderer("cpu")


@pytest.fixture(scope="session")
def tracer_of(renderer: str) -> Callable[..., Any]:
    """A function from a mesh to its ray tracer."""
    from facestage.render.tracer import RayTracer

    def build(mesh: Mesh, **options: int) -> RayTracer:
        tracer = RayTracer(mesh.triangles, len(mesh.vertices), **options)
        tracer.update(mesh.vertices)
        return tracer

    return build
