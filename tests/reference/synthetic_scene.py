"""A synthetic face in front of a camera under a few lights, rendered with the fit's own forward
model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LightStage, fibonacci_stage
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import Known
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from reference.synthetic_face import synthetic_face, synthetic_relief

SIDE = 96
RADIANCE = np.array([[9, 8, 7], [1, 1, 2], [6, 7, 8], [0.5, 0.5, 0.5], [3, 2, 2], [4, 5, 6]], float)


@dataclass(frozen=True)
class Scene:
    """Truth (``state``) and everything that renders it. The stage is in the camera frame."""

    model: FaceModel
    geometry: FaceGeometry
    lights: LightParameters
    stage: LightStage
    forward: ForwardModel
    state: State

    def render(
        self, state: State | None = None, samples: int = 32, seed: int = 77
    ) -> tuple[np.ndarray, np.ndarray]:
        """Image (h, w, 3) and where it shows the face (h, w)."""
        state = self.state if state is None else state
        y, x = np.mgrid[: state.camera.height, : state.camera.width]
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
        surface = self.forward.surface(state, pixels)
        terms = self.forward.light_terms(state, surface, self.stage, samples, seed)
        color, seen = np.zeros((*y.shape, 3)), np.zeros(y.shape, bool)
        column, row = surface.pixels.astype(int).T
        color[row, column] = self.forward.shade(state, surface, terms).color
        seen[row, column] = True
        return color, seen

    def landmarks(
        self, state: State | None = None, noise_px: float = 0.0, seed: int = 0
    ) -> Landmarks:
        """The projected landmarks of a state."""
        state = self.state if state is None else state
        vertices, _ = self.model.landmark_vertices("ibug68")
        points = state.camera.project(self.forward.pose(state)[1][vertices[:, 0]])
        points = points + noise_px * np.random.default_rng(seed).normal(size=points.shape)
        return Landmarks("ibug68", points, np.ones(68, bool))

    def known(self, **changes: Any) -> Known:
        """What bounds and priors of the scene's state depend on."""
        box = self.model.expression_box
        return replace(
            Known(self.lights, self.state.camera.focal_px, expression_box=box), **changes
        )

    def photo_term(
        self, photo: np.ndarray, samples: int, clipped: np.ndarray | None = None, **changes: Any
    ) -> PhotoTerm:
        """Every pixel of ``photo`` (h, w, 3) against the scene's lights."""
        given = plain_photo(photo, clipped)
        return PhotoTerm(self.forward, given, self.stage, samples, **changes)

    def solver(
        self,
        photo: np.ndarray,
        blocks: tuple[str, ...],
        steps: int,
        weights: Weights,
        samples: int = 8,
        landmarks: Landmarks | None = None,
        clipped: np.ndarray | None = None,
    ) -> PhotoDescent:
        """A stage of the schedule over ``blocks`` against ``photo``."""
        layout = Layout(self.state)
        known = self.known(light_scale=float(RADIANCE.mean()))
        energy = Energy(
            layout,
            (
                Priors(layout, known, weights),
                LandmarkTerm(self.geometry, landmarks or self.landmarks(), 0.6, weights.landmarks),
                self.photo_term(photo, samples, clipped=clipped, weight=weights.photo),
            ),
        )
        low, high = layout.bounds(known)
        return PhotoDescent(
            "test", blocks, energy, steps, np.zeros(layout.size, bool), low, high, tolerance=1e-5
        )

    def fit(
        self, stage: PhotoDescent, start: State, seed: int = 3
    ) -> tuple[State, list[Iteration]]:
        """Where the stage ends, and its steps."""
        steps = list(stage.run(start, seed, float("inf")))
        return (steps[-1].state if steps else start), steps


def plain_photo(color: np.ndarray, clipped: np.ndarray | None = None) -> Photo:
    """A photo whose every pixel is usable skin."""
    shape = color.shape[:2]
    clipped = np.zeros(color.shape, bool) if clipped is None else clipped
    return Photo(color=color, usable=np.ones(shape, bool), skin=np.ones(shape), clipped=clipped)


def synthetic_scene(uniform: bool = False, side: int = SIDE, specular_size: int = 6) -> Scene:
    """The synthetic face, turned a little, 60 cm from the camera under six lights."""
    model = synthetic_face()
    geometry = FaceGeometry(model, synthetic_relief(model))
    radiance = RADIANCE
    if uniform:
        radiance = RADIANCE[:, :1] * np.array([1.2, 1.0, 0.8])
    fitted = np.ones(len(radiance), bool)
    lights = LightParameters(fitted, np.zeros_like(radiance), uniform)
    translation = np.array([0.012, -0.008, -0.6])
    matrix = np.eye(4)
    matrix[:3, 3] = translation
    random = np.random.default_rng(4)
    state = State(
        rotation=Rotation.from_rotvec([0.1, 0.25, -0.05]).as_matrix(),
        translation=translation,
        camera=Camera(side, side, 2.1 * side, (0.51 * side, 0.48 * side)),
        identity=np.array([0.8, -0.6, 0.7, 0.5]),
        expression=np.array([0.35, 0.25, 0.4]),
        lights=lights.from_radiance(radiance),
        light_position=np.zeros((len(radiance), 2)),
        albedo=np.array([0.3, -0.5, 0.4, 0.6, -0.3]),
        roughness=0.45,
        specular=0.8 + 0.15 * random.uniform(-1, 1, (specular_size, specular_size)),
        relief=np.zeros(2),
    )
    stage = fibonacci_stage(len(radiance), radius=0.8).transformed(matrix).with_radiance(radiance)
    return Scene(model, geometry, lights, stage, ForwardModel(geometry, lights), state)


def moved(state: State, **change: ArrayLike) -> State:
    """The state with blocks shifted: pose (6,), focal (log), and the rest by their own names."""
    layout = Layout(state)
    step = np.zeros(layout.size)
    for name, value in change.items():
        step[layout.slices[name]] = np.ravel(value)
    return layout.apply(state, step)
