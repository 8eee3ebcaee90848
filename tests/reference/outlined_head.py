"""A head before a dark background, all of whose energy but the photo pulls a little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.job import Weights
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.silhouette import SilhouetteTerm
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import Known
from facestage.fit.forward.shading import ForwardModel
from facestage.models.registry import load_model
from facestage.stress.scene import plain_scene
from reference.synthetic_face import synthetic_relief
from reference.synthetic_scene import moved, plain_photo

WEIGHTS = Weights(landmarks=0.7, prior=1.3, light=0.6, photo=0.4)
FACE, BACK = np.array([0.5, 0.4, 0.3]), np.array([0.05, 0.08, 0.1])


def outlined_head() -> tuple[Energy, State]:
    """The energy of landmarks, outline and priors, and a state a little off. The renderer runs."""
    truth = plain_scene(load_model("default"), side_px=160)
    geometry = FaceGeometry(truth.model, synthetic_relief(truth.model))
    radiance = truth.stage.radiance
    lights = LightParameters(np.ones(len(radiance), bool), np.zeros_like(radiance), uniform=False)
    state = replace(
        truth.state,
        lights=lights.from_radiance(radiance),
        light_position=np.zeros((len(radiance), 2)),
        relief=np.zeros(2),
    )
    forward = ForwardModel(geometry, lights)
    # Turned, so that a cheek is the outline.
    state = moved(state, pose=np.array([0, 0.7, 0, 0, 0, 0]))
    y, x = np.mgrid[: state.camera.height, : state.camera.width]
    seen = forward.hits(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5).triangle >= 0
    photo = plain_photo(np.where(seen.reshape(*y.shape, 1), FACE, BACK))
    vertices, corner = truth.model.landmark_vertices("ibug68")
    placed = np.einsum("mi,mix->mx", corner, forward.pose(state)[1][geometry.new_index[vertices]])
    points = state.camera.project(placed) + np.random.default_rng(1).normal(size=(68, 2))
    landmarks = Landmarks("ibug68", points, np.ones(68, bool))
    layout = Layout(state)
    known = Known(lights, state.camera.focal_px, expression_box=truth.model.expression_box)
    energy = Energy(
        layout,
        (
            Priors(layout, known, WEIGHTS),
            LandmarkTerm(geometry, landmarks, 1.0, WEIGHTS.landmarks),
            SilhouetteTerm(forward, photo, 100.0, WEIGHTS.photo),
        ),
    )
    uneven = np.random.default_rng(3).uniform(-0.1, 0.1, state.specular.shape)
    shift = np.array([0.01, -0.02, 0.01, 0.002, 0.001, 0.004])
    return energy, moved(
        state, pose=shift, albedo=np.full(state.albedo.size, 0.1), roughness=0.05, specular=uneven
    )
