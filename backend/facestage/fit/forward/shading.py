"""The forward model: from a state to the radiance of each pixel that sees the face."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float, Float32, Int, Shaped
from facestage.contract.camera import Camera
from facestage.contract.face_model import SKIN
from facestage.contract.light_stage import LightStage
from facestage.contract.scattering import BULGE_M, MEAN_COSINE, SLANT
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.mixing import mixed
from facestage.fit.face.state import State
from facestage.fit.forward.bounces import Bounces
from facestage.fit.forward.reflectance import Skin, albedo_of, uniform_lobe
from facestage.fit.forward.scattering import Scattering, Spread
from facestage.render.light_terms import PLAIN, Asked, LightTerms, LitPoints
from facestage.render.tracer import Hits, RayTracer


@dataclass(frozen=True)
class Surface:
    """What the pixels see, in the camera frame. P pixels; 3 corners of each hit triangle."""

    pixels: Float[np.ndarray, "pixels 2"]  # x and y
    rays: Float[np.ndarray, "pixels 3"]  # unit, away from the camera
    triangle: Int[np.ndarray, " pixels"]
    corners: Int[np.ndarray, "pixels 3"]  # vertex indices
    weights: Float[np.ndarray, "pixels 3"]  # barycentric
    depth: Float[np.ndarray, " pixels"]  # m along the ray
    points: Float[np.ndarray, "pixels 3"]  # m
    normals: Float[np.ndarray, "pixels 3"]  # unit shading normals
    normal_length: Float[np.ndarray, " pixels"]  # of the interpolated normal before normalising
    facing: Float[np.ndarray, "pixels 3"]  # unit geometric normal on the viewer's side
    corner_normals: Float[np.ndarray, "pixels 3 3"]  # unit vertex normals
    vertices: Float[np.ndarray, "vertices 3"]  # camera frame
    model_vertices: Float[np.ndarray, "vertices 3"]  # model frame
    model_normals: Float[np.ndarray, "vertices 3"]  # unit, model frame
    normal_scale: Float[np.ndarray, " vertices"]  # lengths of the unnormalised vertex normals

    def part(self, where: Shaped[np.ndarray, " _"] | slice) -> Surface:
        """Some of the pixels (a mask, indices or a slice); what belongs to the whole mesh is
        kept.
        """
        whole = {"vertices", "model_vertices", "model_normals", "normal_scale"}
        return replace(
            self, **{name: value[where] for name, value in vars(self).items() if name not in whole}
        )

    def of_vertices(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Float[np.ndarray, "pixels channels"]:
        """What each pixel sees of ``values`` that lie on the mesh's vertices."""
        return mixed(self.weights, self.corners, values)


@dataclass(frozen=True)
class Image:
    """Radiance of the pixels and the factors it is made of."""

    surface: Surface
    terms: LightTerms
    albedo: Float[np.ndarray, "pixels 3"]
    c_spec: Float[np.ndarray, " pixels"]
    radiance: Float[np.ndarray, "lights 3"]  # of the lights
    diffuse: Float[np.ndarray, "pixels 3"]  # irradiance
    specular: Float[np.ndarray, "pixels 3"]
    color: Float[np.ndarray, "pixels 3"]
    spread: Spread | None = None  # of the irradiance below the skin; None: it stays where it is
    excess: Float[np.ndarray, "pixels 3"] | None = None  # see Skin

    @property
    def skin(self) -> Skin:
        """What the pixels see is made of."""
        return Skin(self.albedo, self.c_spec, self.excess)

    @property
    def scattered(self) -> Float32[np.ndarray, "3 pixels lights"] | None:
        """Irradiance by each light as it comes out of the skin; None: as it falls on it."""
        return None if self.spread is None else self.spread.by_light(self.terms.diffuse)


class ForwardModel:
    """Renders one face under one stage; owns the ray tracer's scene."""

    def __init__(
        self, geometry: FaceGeometry, lights: LightParameters, resting: bool = False
    ) -> None:
        """``resting``: which skin lights which is that of the mean shape, found once."""
        self.geometry = geometry
        self.lights = lights
        self.tracer = RayTracer(geometry.triangles, len(geometry.mean))
        self.bounces = Bounces(geometry, resting)

    def pose(
        self, state: State
    ) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices 3"]]:
        """Vertices in the model frame and in the camera frame."""
        model_vertices = self.geometry.at(state)
        return model_vertices, model_vertices @ state.rotation.T + state.translation

    def surface(
        self, state: State, pixels: Float[np.ndarray, "pixels 2"], only_fitted: bool = False
    ) -> Surface:
        """What ``pixels`` see; pixels that see nothing (or nothing that is fitted) are
        dropped.
        """
        model_vertices, vertices = self.pose(state)
        # The tracer works around the face, where float32 has the most digits.
        self.tracer.update(vertices - state.translation)
        rays = pixel_rays(state.camera, pixels)
        hits = self.tracer.first_hits(-state.translation, rays)
        keep = hits.triangle >= 0
        if only_fitted:
            keep &= self.geometry.fitted[hits.triangle]
        triangle, weights, rays = (
            hits.triangle[keep],
            hits.barycentric[keep].astype(np.float64),
            rays[keep],
        )
        corners = self.geometry.triangles[triangle]
        points = mixed(weights, corners, vertices)
        model_normals, normal_scale = self.geometry.vertex_normals(model_vertices)
        vertex_normals = model_normals @ state.rotation.T
        normals = mixed(weights, corners, vertex_normals)
        length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
        a, b, c = (vertices[corners[:, i]] for i in range(3))
        facing = np.cross(b - a, c - a)
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-20)
        facing *= -np.sign(np.einsum("px,px->p", facing, rays))[:, None]
        return Surface(
            pixels=pixels[keep],
            rays=rays,
            triangle=triangle,
            corners=corners,
            weights=weights,
            depth=np.linalg.norm(points, axis=1),
            points=points,
            normals=normals / length[:, None],
            normal_length=length,
            facing=facing,
            corner_normals=vertex_normals[corners],
            vertices=vertices,
            model_vertices=model_vertices,
            model_normals=model_normals,
            normal_scale=normal_scale,
        )

    def box(
        self, state: State, triangles: Bool[np.ndarray, " triangles"] | None = None
    ) -> tuple[slice, slice]:
        """Rows and columns of the photo in which the mesh lies, or some ``triangles`` of it; all of
        them where a part is behind the camera.
        """
        width, height = state.camera.width, state.camera.height
        vertices = self.pose(state)[1]
        if triangles is not None:
            vertices = vertices[np.unique(self.geometry.triangles[triangles])]
        projected = state.camera.project(vertices)
        before = np.isfinite(projected).all(1)
        if not before.any():
            return slice(0, 0), slice(0, 0)
        if not before.all():
            return slice(0, height), slice(0, width)
        limit = [width, height]
        low = np.clip(np.floor(projected.min(0)) - 1, 0, limit).astype(int)
        high = np.clip(np.ceil(projected.max(0)) + 1, 0, limit).astype(int)
        return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))

    def hits(self, state: State, pixels: Float[np.ndarray, "pixels 2"]) -> Hits:
        """What ``pixels`` see first of the rendered mesh at ``state``."""
        self.tracer.update(self.pose(state)[1] - state.translation)
        return self.tracer.first_hits(-state.translation, pixel_rays(state.camera, pixels))

    def light_terms(
        self,
        state: State,
        surface: Surface,
        stage: LightStage,
        samples: int,
        seed: int,
        asked: Asked = PLAIN,
        *,
        traced: Bool[np.ndarray, " lights"] | None = None,
        pairs: tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]] | None = None,
        roughness: Float[np.ndarray, " points"] | None = None,
        bounced: bool = True,
    ) -> LightTerms:
        """Unit-radiance irradiance of the surface by each light of ``stage`` (camera frame).

        Derivatives, where ``asked``, are those of the state's own radiance. ``traced``
        leaves lights out; ``pairs`` of (K,) pixels and (K,) lights leave out all others, see
        :meth:`RayTracer.light_terms`. ``roughness`` replaces the state's one value. Light from
        other skin comes with it as the state says, unless not ``bounced`` or by ``pairs``.
        """
        lit = self.lit_points(state, surface, stage)
        if roughness is not None:
            lit = replace(lit, roughness=roughness)
        derived = asked.by_surface or asked.by_roughness
        radiance = self.lights.radiance(state.lights) if derived else None
        terms = self.tracer.light_terms(
            lit, samples, seed, asked, radiance=radiance, traced=traced, pairs=pairs
        )
        if pairs is not None or not bounced or state.interreflection <= 0:
            return terms
        return replace(terms, indirect=self._indirect(state, surface, lit, seed, traced))

    def _indirect(
        self,
        state: State,
        surface: Surface,
        lit: LitPoints,
        seed: int,
        traced: Bool[np.ndarray, " lights"] | None,
    ) -> Float32[np.ndarray, "3 pixels lights"]:
        """Irradiance from other skin by each light, at the state's strength."""
        received = self.bounces.irradiance(
            self.tracer,
            surface.vertices - state.translation,
            self.log_albedo(state),
            lit.stage,
            lit.numbers,
            float(state.specular.mean()),
            seed,
            traced,
        )
        received *= np.float32(state.interreflection)
        return self.bounces.at_pixels(received, surface.corners, surface.weights)

    def lit_points(self, state: State, surface: Surface, stage: LightStage) -> LitPoints:
        """The surface and its lights as the tracer takes them; ``stage`` is in the camera frame."""
        centred = np.eye(4)
        centred[:3, 3] = -state.translation
        numbers = np.arange(len(stage)) if self.lights.numbers is None else self.lights.numbers
        return LitPoints(
            surface.points - state.translation,
            surface.normals,
            surface.facing,
            -surface.rays,
            stage.transformed(centred),
            state.roughness,
            _pixel_keys(surface.pixels),
            numbers,
        )

    def shade(
        self,
        state: State,
        surface: Surface,
        terms: LightTerms,
        albedo: Float[np.ndarray, "pixels 3"] | None = None,
        radiance: Float[np.ndarray, "lights 3"] | None = None,
        c_spec: Float[np.ndarray, " pixels"] | None = None,
        spread: Spread | None = None,
    ) -> Image:
        """Radiance towards the camera; ``albedo``, ``radiance``, ``c_spec``
        replace the state's.

        ``spread``: how light goes on below the skin of more than these pixels; by default, as the
        state says, of them alone.
        """
        if radiance is None:
            radiance = self.lights.radiance(state.lights)
        if albedo is None:
            albedo = self.albedo(state, surface)
        if c_spec is None:
            c_spec = sample_bilinear(state.specular, self.uvs(surface))
        if spread is None and state.scattering > 0:
            spread = self.scattering(surface, state.scattering)
        diffuse = (
            terms.diffuse @ radiance if spread is None else spread.lit(terms.diffuse, radiance)
        )
        specular = terms.specular @ radiance
        if terms.indirect.size:
            indirect = np.einsum("cpn,nc->pc", terms.indirect, radiance)
            diffuse, specular = diffuse + indirect, specular + uniform_lobe(indirect)
        excess = self.excess(state, surface)
        color = Skin(albedo, c_spec, excess).radiance(diffuse, specular)
        return Image(
            surface, terms, albedo, c_spec, radiance, diffuse, specular, color, spread, excess
        )

    def excess(self, state: State, surface: Surface) -> Float[np.ndarray, "pixels 3"] | None:
        """How unevenly light comes out of the skin that the pixels see; None: evenly."""
        return state.translucency * self.unevenness(surface) if state.translucency else None

    def unevenness(self, surface: Surface) -> Float[np.ndarray, "pixels 3"]:
        """The same of a random walk: the terms of contract/scattering.py, on skin."""
        skin = self.geometry.triangle_part[surface.triangle] == SKIN
        cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
        bulge = mixed(surface.weights, surface.corners, self.bulges(surface))
        slant = SLANT * (MEAN_COSINE - cosine)
        return skin[:, None] * (slant[:, None] + bulge[:, None] * np.array(BULGE_M))

    def bulges(self, surface: Surface) -> Float[np.ndarray, " vertices"]:
        """Mean curvature of the whole mesh, 1 / m, convex positive."""
        return self.geometry.bends.at(surface.model_vertices, surface.model_normals)

    def scattering(
        self, surface: Surface, strength: float, among: Bool[np.ndarray, " pixels"] | None = None
    ) -> Scattering:
        """How light spreads below the skin that the surface's pixels, or those ``among``, see."""
        skin = self.geometry.triangle_part[surface.triangle] == SKIN
        if among is not None:
            skin &= among
        return Scattering.over(
            surface.pixels, surface.points, surface.rays, surface.normals, skin, strength
        )

    def log_albedo(self, state: State) -> Float[np.ndarray, "vertices 3"]:
        """Log of the vertex albedo, not yet clipped."""
        return self.geometry.log_albedo + np.tensordot(
            state.albedo.astype(np.float32), self.geometry.albedo_basis, 1
        )

    def albedo(self, state: State, surface: Surface) -> Float[np.ndarray, "pixels 3"]:
        """Diffuse albedo from the coefficients: logs are interpolated, then clipped below
        1.
        """
        logs = surface.of_vertices(self.log_albedo(state))
        return albedo_of(logs)

    def uvs(self, surface: Surface) -> Float[np.ndarray, "pixels 2"]:
        """Texture coordinates."""
        corners = self.geometry.triangle_uvs[surface.triangle]
        return mixed(surface.weights, corners, self.geometry.model.uvs)


def _pixel_keys(pixels: Float[np.ndarray, "pixels 2"]) -> Int[np.ndarray, " pixels"]:
    """A number for each pixel, the same whichever other pixels see the face."""
    x, y = pixels.astype(np.int64).T
    return (y << 16) + x


def pixel_rays(
    camera: Camera, pixels: Float[np.ndarray, "pixels 2"]
) -> Float[np.ndarray, "pixels 3"]:
    """Unit directions in the camera frame through ``pixels``."""
    x = (pixels[:, 0] - camera.principal_px[0]) / camera.focal_px
    y = -(pixels[:, 1] - camera.principal_px[1]) / camera.focal_px
    rays = np.stack([x, y, -np.ones_like(x)], axis=1)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def bilinear_weights(
    uvs: Float[np.ndarray, "pixels 2"], size: int
) -> tuple[Int[np.ndarray, "pixels 4"], Float[np.ndarray, "pixels 4"]]:
    """Texel indices into a (size, size) texture and their weights; edges clamp."""
    x = np.clip(uvs[:, 0] * size - 0.5, 0, size - 1)
    y = np.clip((1 - uvs[:, 1]) * size - 0.5, 0, size - 1)
    x0, y0 = (
        np.minimum(x.astype(int), max(size - 2, 0)),
        np.minimum(y.astype(int), max(size - 2, 0)),
    )
    fx, fy = x - x0, y - y0
    x1, y1 = np.minimum(x0 + 1, size - 1), np.minimum(y0 + 1, size - 1)
    index = np.stack([y0 * size + x0, y0 * size + x1, y1 * size + x0, y1 * size + x1], axis=1)
    return index, np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], axis=1)


def sample_bilinear(
    texture: Float[np.ndarray, "texels texels ..."], uvs: Float[np.ndarray, "pixels 2"]
) -> Float[np.ndarray, "pixels ..."]:
    """Values of a square texture (row 0 at v = 1) at ``uvs``."""
    index, weight = bilinear_weights(uvs, texture.shape[0])
    flat = texture.reshape(texture.shape[0] ** 2, *texture.shape[2:])
    return mixed(weight, index, flat)
