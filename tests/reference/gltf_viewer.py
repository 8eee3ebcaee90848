"""A glTF binary as a program without Blender shows it: loaded by trimesh, drawn by Mitsuba.

Of its materials it knows what trimesh does: base color, roughness and normals, one specular level
for all. What trimesh leaves out, morph targets, is read here, by the specification's section 3.6
(accessors, sparse ones too).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.camera import Camera

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # glTF's Y is up
BOUNCES = 4
TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class AreaLamp:
    """A rectangle that shines along its -Z: its pose in the world (4, 4), sides (2,) in metres and
    linear radiance (3,).
    """

    pose: np.ndarray
    sides: np.ndarray
    radiance: np.ndarray


@dataclass(frozen=True)
class Part:
    """A primitive of the file's mesh: its triangles, in the world's metres with Z up."""

    vertices: np.ndarray  # (n, 3)
    targets: Mapping[str, np.ndarray]  # (n, 3) by the morph target's name
    triangles: np.ndarray  # (t, 3)
    uvs: np.ndarray  # (n, 2) from the bottom left
    color: np.ndarray  # (h, w, 3) linear
    roughness: np.ndarray  # (h, w)
    normals: np.ndarray | None  # (h, w, 3) of the normal map, 0..1


@dataclass(frozen=True)
class Viewed:
    """What is in a file, and the weights that it gives its morph targets."""

    parts: list[Part]
    weights: Mapping[str, float]

    def picture(
        self,
        camera: Camera,
        camera_pose: np.ndarray,
        lamps: Sequence[AreaLamp],
        samples: int = 64,
        weights: Mapping[str, float] | None = None,
    ) -> np.ndarray:
        """(h, w, 4) linear RGB and coverage, from a camera that looks along its -Z; ``weights`` of
        the morph targets instead of the file's.
        """
        import mitsuba as mi

        from facestage.render.variant import load_dict, start_renderer

        start_renderer("cpu")
        turned = camera_pose @ np.diag([-1.0, 1.0, -1.0, 1.0])
        middle = np.array(camera.principal_px) / [camera.width, camera.height] - 0.5
        scene: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": BOUNCES + 1, "hide_emitters": True},
            "sensor": {
                "type": "perspective",
                "fov_axis": "x",
                "fov": float(2 * np.degrees(np.arctan(0.5 * camera.width / camera.focal_px))),
                "principal_point_offset_x": float(-middle[0]),
                "principal_point_offset_y": float(-middle[1]),
                "near_clip": 0.01,
                "to_world": mi.ScalarTransform4f(turned.tolist()),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "pixel_format": "rgba",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": samples},
            },
        }
        for number, lamp in enumerate(lamps):
            shape = np.diag([0.5 * lamp.sides[0], -0.5 * lamp.sides[1], -1.0, 1.0])
            scene[f"lamp{number}"] = {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f((lamp.pose @ shape).tolist()),
                "emitter": {
                    "type": "area",
                    "radiance": {"type": "rgb", "value": lamp.radiance.tolist()},
                },
            }
        given = self.weights if weights is None else weights
        for number, part in enumerate(self.parts):
            scene[f"part{number}"] = _mesh(part, given)
        return np.array(mi.render(load_dict(scene), spp=samples, seed=0))


def view(path: Path) -> Viewed:
    """Load a .glb file with trimesh."""
    import trimesh

    loaded = trimesh.load_scene(path, process=False)
    described, blob = _chunks(path.read_bytes())
    primitives = [
        (mesh, primitive) for mesh in described["meshes"] for primitive in mesh["primitives"]
    ]
    assert len(primitives) == len(loaded.geometry), "trimesh has other primitives than the file"
    weights: dict[str, float] = {}
    parts = []
    for (mesh, primitive), (name, found) in zip(primitives, loaded.geometry.items(), strict=True):
        names = mesh.get("extras", {}).get("targetNames", [])
        weights |= dict(zip(names, mesh.get("weights", []), strict=False))
        (node,) = loaded.graph.geometry_nodes[name]
        matrix = Z_UP @ loaded.graph.get(node)[0]
        moved = [
            _accessor(described, blob, target["POSITION"]) @ matrix[:3, :3].T
            for target in primitive.get("targets", [])
        ]
        material, uvs = found.visual.material, np.asarray(found.visual.uv)
        parts.append(
            Part(
                found.vertices @ matrix[:3, :3].T + matrix[:3, 3],
                dict(zip(names, moved, strict=True)),
                np.asarray(found.faces),
                uvs,
                *_maps(material),
            )
        )
    return Viewed(parts, weights)


def _maps(material: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Base color, roughness and normal map of trimesh's material."""
    from facestage.contract.files.color import srgb_to_linear

    def pixels(picture: Any) -> np.ndarray:
        return np.asarray(picture.convert("RGB"), np.float32) / 255

    color = np.ones((1, 1, 3), np.float32)
    if material.baseColorTexture is not None:
        color = srgb_to_linear(pixels(material.baseColorTexture))
    if material.baseColorFactor is not None:
        color = color * np.asarray(material.baseColorFactor[:3], np.float32) / 255
    factor = 1.0 if material.roughnessFactor is None else float(material.roughnessFactor)
    roughness = np.full((1, 1), factor, np.float32)
    if material.metallicRoughnessTexture is not None:
        roughness = factor * pixels(material.metallicRoughnessTexture)[..., 1]
    bent = None if material.normalTexture is None else pixels(material.normalTexture)
    return color, roughness, bent


def _mesh(part: Part, weights: Mapping[str, float]) -> Any:
    import mitsuba as mi

    from facestage.render.variant import load_dict

    points = part.vertices.copy()
    for name, by in part.targets.items():
        points += weights.get(name, 0.0) * by
    surface: dict[str, Any] = {
        "type": "principled",
        "base_color": _texture(part.color),
        "roughness": _texture(part.roughness[..., None]),
        "specular": 0.5,
    }
    if part.normals is not None:
        surface = {"type": "normalmap", "normalmap": _texture(part.normals), "bsdf": surface}
    properties = mi.Properties()
    properties["bsdf"] = load_dict({"type": "twosided", "bsdf": surface})
    mesh = mi.Mesh(
        "part",
        vertex_count=len(points),
        face_count=len(part.triangles),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    parameters = mi.traverse(mesh)
    parameters["faces"] = mi.UInt32(np.ascontiguousarray(part.triangles, np.uint32).ravel())
    parameters["vertex_positions"] = mi.Float(np.ascontiguousarray(points, np.float32).ravel())
    from_top = np.c_[part.uvs[:, 0], 1.0 - part.uvs[:, 1]]
    parameters["vertex_texcoords"] = mi.Float(np.ascontiguousarray(from_top, np.float32).ravel())
    normals = _normals(part, points)
    parameters["vertex_normals"] = mi.Float(np.ascontiguousarray(normals, np.float32).ravel())
    parameters.update()
    return mesh


def _normals(part: Part, points: np.ndarray) -> np.ndarray:
    """(n, 3) of the surface as it is bent, by area; vertices that seams divide share theirs."""
    _, place = np.unique(part.vertices.round(7), axis=0, return_inverse=True)
    place = place.ravel()
    a, b, c = (points[part.triangles[:, corner]] for corner in range(3))
    sums = np.zeros((place.max() + 1, 3))
    np.add.at(sums, place[part.triangles].ravel(), np.repeat(np.cross(b - a, c - a), 3, axis=0))
    return (sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-20))[place]


def _texture(pixels: np.ndarray) -> dict[str, Any]:
    import mitsuba as mi

    bitmap = mi.Bitmap(np.ascontiguousarray(pixels, np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "clamp"}


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The description and the binary chunk of a .glb."""
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def _accessor(described: dict[str, Any], blob: bytes, index: int) -> np.ndarray:
    """(n, width) the values of an accessor, single where they are sparse."""
    each = described["accessors"][index]
    count, width, kind = each["count"], WIDTHS[each["type"]], TYPES[each["componentType"]]

    def read(view: int, offset: int, wanted: int, kind: Any, width: int) -> np.ndarray:
        start = described["bufferViews"][view].get("byteOffset", 0) + offset
        return np.frombuffer(blob, kind, wanted * width, start).reshape(wanted, width)

    values = np.zeros((count, width), kind)
    if "bufferView" in each:
        values = read(each["bufferView"], each.get("byteOffset", 0), count, kind, width).copy()
    if "sparse" in each:
        sparse = each["sparse"]
        at, to = sparse["indices"], sparse["values"]
        rows = read(
            at["bufferView"],
            at.get("byteOffset", 0),
            sparse["count"],
            TYPES[at["componentType"]],
            1,
        )
        values[rows[:, 0]] = read(
            to["bufferView"], to.get("byteOffset", 0), sparse["count"], kind, width
        )
    return values
