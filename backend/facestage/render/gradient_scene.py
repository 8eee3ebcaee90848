"""The face under the stage as an ordinary Mitsuba scene that Mitsuba itself differentiates.

What the fit is measured against: mesh, area lights, path integrator and automatic differentiation
as in Mitsuba's tutorials, with the skin's own reflectance. The scene is made once and updated
through its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.contract import brdf
from facestage.contract.camera import Camera
from facestage.contract.light_stage import LightStage
from facestage.render.brdf import specular_lobe
from facestage.render.variant import load_dict

SKIN = "facestage_skin"
ALBEDO, C_SPEC = "vertex_albedo", "vertex_specular"
_registered: set[str] = set()


@dataclass(frozen=True)
class SceneValues:
    """Everything of the scene that is differentiated; as a gradient, the derivatives by it."""

    vertices: np.ndarray  # (m, 3) m, camera frame
    albedo: np.ndarray  # (m, 3)
    c_spec: np.ndarray  # (m,)
    roughness: float
    radiance: np.ndarray  # (N, 3)


@dataclass(frozen=True)
class Target:
    """The photo and how much each pixel counts; all at the camera's size."""

    color: np.ndarray  # (h, w, 3) linear
    clipped: np.ndarray  # (h, w, 3) bool: "at least this bright"
    weights: np.ndarray  # (h, w)


class GradientScene:
    """One face, one camera, N square lights; renders, and differentiates 1/2 sum w (image -
    photo)^2.
    """

    def __init__(
        self, triangles: np.ndarray, camera: Camera, stage: LightStage, values: SceneValues
    ) -> None:
        """``stage`` is in the camera frame; ``values`` are where the scene starts."""
        _register()
        count = len(values.vertices)
        properties = mi.Properties()
        properties["skin"] = load_dict({"type": SKIN})
        mesh = mi.Mesh(
            "face",
            vertex_count=count,
            face_count=len(triangles),
            has_vertex_normals=True,
            props=properties,
        )
        mesh.add_attribute(ALBEDO, 3, np.ascontiguousarray(values.albedo, np.float32).ravel())
        mesh.add_attribute(C_SPEC, 1, np.ascontiguousarray(values.c_spec, np.float32))
        parameters = mi.traverse(mesh)
        parameters["faces"] = mi.UInt32(np.ascontiguousarray(triangles, np.uint32).ravel())
        parameters["vertex_positions"] = _flat(values.vertices)
        parameters.update()
        self._lights = [f"light_{number}.emitter.radiance.value" for number in range(len(stage))]
        self._scene = load_dict(_description(mesh, camera, stage))
        self._parameters = mi.traverse(self._scene)
        self._roughness = next(key for key in self._parameters if key[0].endswith("roughness"))[0]

    def render(self, values: SceneValues, samples: int, seed: int) -> np.ndarray:
        """(h, w, 3) linear image with ``samples`` paths per pixel."""
        self._set(values, differentiate=False)
        return np.array(mi.render(self._scene, spp=samples, seed=seed))

    def gradient(
        self, values: SceneValues, target: Target, samples: int, seed: int
    ) -> tuple[float, SceneValues]:
        """The loss and its derivatives, by one render forward and one backward."""
        self._set(values, differentiate=True)
        image = mi.render(self._scene, self._parameters, spp=samples, seed=seed, seed_grad=seed + 1)
        difference = image - mi.TensorXf(np.ascontiguousarray(target.color, np.float32))
        shape = target.color.shape
        weights = np.where(target.clipped, 0.0, target.weights[..., None]).astype(np.float32)
        below = np.where(target.clipped, target.weights[..., None], 0.0).astype(np.float32)
        # A clipped pixel only says "at least this bright": nothing is wrong with being brighter.
        squared = dr.square(difference) * mi.TensorXf(weights)
        squared += dr.square(dr.minimum(difference, 0)) * mi.TensorXf(below)
        loss = 0.5 * dr.sum(squared.array)
        dr.backward(loss)

        def derivative(name: str) -> np.ndarray:
            return np.array(dr.grad(self._parameters[name])).astype(np.float64)

        assert image.shape == shape
        return float(loss[0]), SceneValues(
            vertices=derivative("face.vertex_positions").reshape(-1, 3),
            albedo=derivative(f"face.{ALBEDO}").reshape(-1, 3),
            c_spec=derivative(f"face.{C_SPEC}").ravel(),
            roughness=float(derivative(self._roughness).ravel()[0]),
            radiance=np.stack([derivative(name).ravel() for name in self._lights]),
        )

    def _set(self, values: SceneValues, differentiate: bool) -> None:
        new = {
            "face.vertex_positions": _flat(values.vertices),
            f"face.{ALBEDO}": _flat(values.albedo),
            f"face.{C_SPEC}": _flat(values.c_spec),
            self._roughness: dr.opaque(mi.Float, float(values.roughness)),
        }
        new |= {
            name: mi.Color3f(*(dr.opaque(mi.Float, float(channel)) for channel in radiance))
            for name, radiance in zip(self._lights, values.radiance, strict=True)
        }
        for name, value in new.items():
            if differentiate:
                dr.enable_grad(value)
            self._parameters[name] = value
        self._parameters.update()


def _description(mesh: Any, camera: Camera, stage: LightStage) -> dict[str, Any]:
    offset_x = 0.5 - camera.principal_px[0] / camera.width
    offset_y = 0.5 - camera.principal_px[1] / camera.height
    scene: dict[str, Any] = {
        "type": "scene",
        # Direct light only, with emitter and BRDF sampling.
        "integrator": {"type": "prb", "max_depth": 2, "hide_emitters": True},
        "sensor": {
            "type": "perspective",
            "fov_axis": "x",
            "fov": float(np.degrees(2 * np.arctan(0.5 * camera.width / camera.focal_px))),
            "principal_point_offset_x": offset_x,
            "principal_point_offset_y": offset_y,
            "near_clip": 1e-3,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]
            ),
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "pixel_format": "rgb",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
        "face": mesh,
    }
    for number in range(len(stage)):
        half = 0.5 * stage.side[number]
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1] = half * stage.axis_x[number], half * stage.axis_y[number]
        matrix[:3, 2], matrix[:3, 3] = stage.direction[number], stage.position[number]
        scene[f"light_{number}"] = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(matrix),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
        }
    return scene


def _flat(values: np.ndarray) -> mi.Float:
    return mi.Float(np.ascontiguousarray(values, np.float32).ravel())


def _register() -> None:
    """Tell Mitsuba of the skin's reflectance, once per variant; its base class depends on the
    variant.
    """
    if mi.variant() in _registered:
        return
    _registered.add(mi.variant())

    class Skin(mi.BSDF):
        """Lambert plus Cook-Torrance with the constants of ``contract.brdf``; attributes of the
        mesh as maps.
        """

        def __init__(self, properties: mi.Properties) -> None:
            mi.BSDF.__init__(self, properties)
            self.roughness = mi.Float(0.4)
            reflection = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection
            self.m_components = [reflection | mi.BSDFFlags.FrontSide]
            self.m_flags = self.m_components[0]

        def traverse(self, callback: Any) -> None:
            callback.put("roughness", self.roughness, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys: Any) -> None:
            dr.make_opaque(self.roughness)

        def sample(self, context: Any, si: Any, _sample1: Any, sample2: Any, active: Any) -> Any:
            wo = mi.warp.square_to_cosine_hemisphere(sample2)
            sample = dr.zeros(mi.BSDFSample3f)
            sample.wo, sample.eta = wo, 1.0
            sample.pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
            sample.sampled_type = mi.UInt32(+self.m_flags)
            sample.sampled_component = 0
            active = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (sample.pdf > 0)
            value = self.eval(context, si, wo, active) / dr.select(active, sample.pdf, 1)
            return sample, dr.select(active, value, 0)

        def eval(self, _context: Any, si: Any, wo: Any, active: Any) -> Any:
            nv, nl = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
            active = active & (nv > 0) & (nl > 0)
            nv, nl = dr.maximum(nv, 1e-3), dr.maximum(nl, 0)
            half = si.wi + wo
            half = half * dr.rsqrt(dr.maximum(dr.squared_norm(half), 1e-12))
            nh, vh = dr.maximum(half.z, 0), dr.clip(dr.dot(si.wi, half), 0, 1)
            complement = dr.square(half.x) + dr.square(half.y)
            lobe = specular_lobe(nl, nv, complement, nh, vh, self.roughness).value
            albedo = si.shape.eval_attribute_3(ALBEDO, si, active)
            c_spec = si.shape.eval_attribute_1(C_SPEC, si, active)
            value = brdf.matte(albedo, nl) + brdf.gloss(c_spec, lobe)
            return dr.select(active, mi.Color3f(value), 0)

        def pdf(self, _context: Any, si: Any, wo: Any, active: Any) -> Any:
            cosine = mi.Frame3f.cos_theta(wo)
            active = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (cosine > 0)
            return dr.select(active, dr.inv_pi * cosine, 0)

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any) -> Any:
            return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

        def to_string(self) -> str:
            return f"{SKIN}[]"

    mi.register_bsdf(SKIN, Skin)
