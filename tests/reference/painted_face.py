"""The default head before a camera under two lights, with maps that its basis does not know, as the
fit sees it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.light_stage import ON, LightStage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, Image, Surface, sample_bilinear
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.shown import Shown
from facestage.models.registry import load_model
from facestage.render.light_terms import Asked

SIDE, DISTANCE, FOCAL = 160, 0.6, 500.0
C_SPEC, ROUGHNESS = 0.8, 0.4
SAMPLES = 16


@dataclass(frozen=True)
class PaintedFace:
    """Geometry, light and pose; pictures of it come from :meth:`photo`."""

    forward: ForwardModel
    state: State
    stage: LightStage
    atlas: Atlas  # of the albedo
    surface: Surface

    def photo(
        self,
        log_albedo: np.ndarray | None = None,
        specular: np.ndarray | None = None,
        roughness: np.ndarray | None = None,
        state: State | None = None,
    ) -> tuple[np.ndarray, Image]:
        """(P, 3) radiance of the surface's pixels with maps added to the plain ones, and the plain
        image.
        """
        uvs = self.forward.uvs(self.surface)
        state, surface = state or self.state, self.surface
        if state is not self.state:
            surface = self.forward.surface(state, self.surface.pixels)
            assert len(surface.pixels) == len(self.surface.pixels)
            uvs = self.forward.uvs(surface)
        rough = None if roughness is None else ROUGHNESS + sample_bilinear(roughness, uvs)
        terms = self.forward.light_terms(
            state, surface, self.stage, SAMPLES, 5, Asked(by_roughness=True), roughness=rough
        )
        plain = self.forward.shade(state, surface, terms)
        albedo = (
            plain.albedo
            if log_albedo is None
            else plain.albedo * np.exp(sample_bilinear(log_albedo, uvs))
        )
        c_spec = plain.c_spec if specular is None else plain.c_spec + sample_bilinear(specular, uvs)
        return self.forward.shade(state, surface, terms, albedo, c_spec=c_spec).color, plain

    def shown(self, photo: np.ndarray, clear: np.ndarray | None = None) -> Shown:
        """What ``photo`` (P, 3) shows to a fit that has found shape, light and everything plain."""
        _, plain = self.photo()
        return Shown(
            image=plain,
            uvs=self.forward.uvs(self.surface),
            photo=photo,
            clipped=np.zeros(photo.shape, bool),
            clear=np.ones(len(photo)) if clear is None else clear,
            doubt=np.zeros(len(photo)),
            feature=np.zeros(len(photo)),
            lips=np.zeros(len(photo)),
            crease=np.zeros(len(photo)),
            face_px=float(np.ptp(self.surface.pixels[:, 1])),
            shift_px=1,
            lifted=np.zeros((SIDE, SIDE), np.float32),
            hanging=np.zeros((SIDE, SIDE), bool),
        )

    def uv_blob(self, size: int, point: tuple[float, float, float], radius: float) -> np.ndarray:
        """(size, size) 0..1: the texels within ``radius`` metres of the skin below ``point`` of the
        mean face.
        """
        atlas = self.atlas if size == self.atlas.size else Atlas.build(self.forward.geometry, size)
        place = atlas.bake(self.forward.geometry.mean.astype(np.float32))
        centre = place[atlas.skin][
            np.linalg.norm(place[atlas.skin] - np.array(point), axis=1).argmin()
        ]
        distance = np.linalg.norm(place - centre, axis=2)
        return np.where(atlas.skin, np.clip(1.5 - distance / radius, 0, 1), 0.0).astype(np.float32)


def painted_face(texels: int = 256, key_side: float = 0.06) -> PaintedFace:
    """A key light from the upper right that throws the nose's shadow, and a weak wide one from the
    front.
    """
    geometry = FaceGeometry(load_model("default"))
    towards = np.array([[0.65, 0.4, 0.65], [-0.1, 0.0, 1.0]])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    axis = np.cross([0.0, 1.0, 0.0], towards)
    side = np.array([key_side, 0.5])
    radiance = np.array([0.35, 0.02])[:, None] * np.ones(3) / side[:, None] ** 2
    stage = LightStage(
        0.8 * towards + [0, 0, -DISTANCE],
        -towards,
        axis / np.linalg.norm(axis, axis=1, keepdims=True),
        side,
        radiance,
        np.full(2, ON),
    )
    lights = LightParameters(np.ones(2, bool), np.zeros((2, 3)), uniform=False)
    model = geometry.model
    state = State(
        rotation=np.eye(3),
        translation=np.array([0.0, 0.0, -DISTANCE]),
        camera=Camera(SIDE, SIDE, FOCAL, (SIDE / 2, SIDE / 2)),
        identity=np.zeros(len(model.identity_names)),
        expression=np.zeros(len(model.expression_names)),
        lights=lights.from_radiance(radiance),
        light_position=np.zeros((2, 2)),
        albedo=np.zeros(len(model.albedo_basis)),
        roughness=ROUGHNESS,
        specular=np.full((32, 32), C_SPEC),
    )
    forward = ForwardModel(geometry, lights)
    y, x = np.mgrid[:SIDE, :SIDE]
    surface = forward.surface(
        state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5, only_fitted=True
    )
    return PaintedFace(forward, state, stage, Atlas.build(geometry, texels), surface)


def moved_by_a_pixel(face: PaintedFace) -> State:
    """The pose of a face whose fit is off by one pixel."""
    shift = DISTANCE / face.state.camera.focal_px
    return replace(face.state, translation=face.state.translation + np.array([shift, 0.0, 0.0]))
