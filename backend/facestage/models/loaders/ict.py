"""ICT-FaceKit (Li et al. 2020, "Learning Formation of Physically-Based Face Attributes"), MIT
licence.

Reads the published folder of .obj files, or an archive of it, and gives the one face model form.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, SKIN, TEETH, FaceModel
from facestage.contract.files.json_text import decode_json
from facestage.models.anatomy.regions import PART_ALBEDO, eyeball_colors, mouth_colors
from facestage.models.anatomy.shipped_landmarks import SCHEME, read_table
from facestage.models.anatomy.skin import albedo_basis
from facestage.models.files.obj_text import Mesh, parse_mesh, parse_vertices
from facestage.models.files.published_archive import published_files
from facestage.models.mesh.skinning import gaze_rotations

LICENSE = "MIT (USC Institute for Creative Technologies)"
SOURCE = "https://github.com/ICT-VGL/ICT-FaceKit"
VERTEX_COUNT, POLYGON_COUNT = 26719, 26384
# ends of the nested vertex ranges in the published order
NARROW_FACE, FACE, SKIN_END = 6706, 9409, 11248

# (first polygon, part, atlas corner u, v, scale): the published UV tiles, packed into one square.
_TILES = (
    (0, SKIN, (0.0, 0.25), 0.75),  # face
    (9230, SKIN, (0.75, 0.75), 0.25),  # back of the head and neck
    (11144, MOUTH, (0.75, 0.75), 0.25),  # mouth socket
    (13226, SKIN, (0.75, 0.75), 0.25),  # eye sockets
    (14034, MOUTH, (0.75, 0.5), 0.25),  # gums and tongue
    (17006, TEETH, (0.75, 0.25), 0.25),
    # left eye: outer shell (sclera and cornea), then the inner ball with the iris
    (21496, EYES, (0.0, 0.0), 0.2),
    (22296, EYES, (0.2, 0.0), 0.2),
    (23094, EYES, (0.4, 0.0), 0.2),  # right eye
    (23894, EYES, (0.6, 0.0), 0.2),
    (24692, OTHER, (0.8, 0.0), 0.2),  # tear film, lashes and other see-through shells: not rendered
)
_GUMS_AND_TONGUE = slice(_TILES[4][0], _TILES[5][0])
_JAW = "jawOpen"
_EYES = ((21451, 23021), (23021, 24591))  # first vertex, end; both shells
_SCLERA = 770  # vertices of the outer shell, the first of each eye

FOLDER, NEUTRAL, LANDMARKS = "FaceXModel", "generic_neutral_mesh.obj", "vertex_indices.json"
LANDMARK_COUNT = 68


def load_ict(path: Path) -> FaceModel:
    """The full model: 100 identity modes and every published expression shape, in metres.

    ``path`` is the repository's folder, its FaceXModel folder, or a .zip/.tar(.xz/.gz/.bz2) of
    either. Raises InputError when it is none of these or a file is missing, damaged or larger than
    any published one.
    """
    path = Path(path)
    try:
        return _assemble(_read(path))
    except (ValueError, LookupError, TypeError, ArithmeticError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"ICT-FaceKit in '{path}' is damaged ({reason}); fetch it again from {SOURCE}."
        ) from error


@dataclass(frozen=True)
class _Published:
    """What the files hold, in their own unit and order."""

    neutral: Mesh
    landmarks: np.ndarray  # (68,) vertex indices
    shapes: dict[str, np.ndarray]  # name -> (n, 3) positions


def _read(path: Path) -> _Published:
    neutral = landmarks = None
    shapes: dict[str, np.ndarray] = {}
    for name, content in published_files(path, FOLDER, _is_wanted, "ICT-FaceKit path", SOURCE):
        if name == LANDMARKS:
            landmarks = content
        elif name == NEUTRAL:
            neutral = parse_mesh(content, name)
        else:
            shapes[name] = _vertices(parse_vertices(content, name), name)
    for needed, found in ((NEUTRAL, neutral), (LANDMARKS, landmarks)):
        if found is None:
            raise InputError(
                f"'{path}' has no {FOLDER}/{needed}; expected ICT-FaceKit as published at {SOURCE}."
            )
    assert neutral is not None and landmarks is not None
    if (len(neutral.vertices), len(neutral.polygons)) != (VERTEX_COUNT, POLYGON_COUNT):
        raise InputError(
            f"'{path}': {NEUTRAL} has {len(neutral.vertices)} vertices and {len(neutral.polygons)} "
            f"polygons, expected {VERTEX_COUNT} and {POLYGON_COUNT}; fetch ICT-FaceKit again from "
            f"{SOURCE}."
        )
    return _Published(neutral, _landmarks(landmarks), shapes)


def _is_wanted(name: str) -> bool:
    return name.endswith(".obj") or name == LANDMARKS


def _vertices(vertices: np.ndarray, name: str) -> np.ndarray:
    if len(vertices) != VERTEX_COUNT:
        raise InputError(
            f"ICT-FaceKit's {name} has {len(vertices)} vertices, expected {VERTEX_COUNT}; it "
            "is truncated."
        )
    return vertices


def _landmarks(content: bytes) -> np.ndarray:
    data = decode_json(content)
    indices = data.get("idx_to_landmark_verts") if isinstance(data, dict) else None
    if (
        not isinstance(indices, list)
        or len(indices) != LANDMARK_COUNT
        or not all(type(index) is int and 0 <= index < VERTEX_COUNT for index in indices)
    ):
        raise ValueError(
            f"{LANDMARKS} has no list idx_to_landmark_verts of {LANDMARK_COUNT} vertices"
        )
    return np.array(indices)


def _assemble(published: _Published) -> FaceModel:
    neutral, texture = published.neutral.vertices, published.neutral.texture
    polygons, polygon_uvs = published.neutral.polygons, published.neutral.polygon_texture
    identity_files = sorted(name for name in published.shapes if name.startswith("identity"))
    expression_files = sorted(name for name in published.shapes if name not in identity_files)
    if not identity_files or not expression_files:
        raise ValueError("it has no identity*.obj or no expression shapes")

    centimetre = 0.01
    centre = neutral[:NARROW_FACE].mean(0)

    def basis(files: Iterable[str]) -> np.ndarray:
        return np.stack([(published.shapes[name] - neutral) * centimetre for name in files]).astype(
            np.float32
        )

    vertices = ((neutral - centre) * centimetre).astype(np.float32)
    expression_names = tuple(Path(name).stem for name in expression_files)
    expressions = basis(expression_files)
    _turn_eyeballs(vertices, expression_names, expressions)
    part, uvs = _parts_and_atlas(texture, polygon_uvs)
    jaw = dict(zip(expression_names, expressions, strict=True)).get(_JAW)
    mean, albedo = _albedo(vertices, polygons, part, jaw)
    landmarks = published.landmarks
    return FaceModel(
        name="ICT-FaceKit",
        license=LICENSE,
        source=SOURCE,
        vertices=vertices,
        polygons=polygons,
        polygon_uvs=polygon_uvs,
        polygon_part=part,
        uvs=uvs,
        identity_names=tuple(Path(name).stem for name in identity_files),
        identity_basis=basis(identity_files),
        expression_names=expression_names,
        expression_basis=expressions,
        albedo_mean=mean,
        albedo_basis=albedo,
        face_tile=(*_TILES[0][2], _TILES[0][3]),
        landmarks={
            "ibug68": np.stack([landmarks] * 3 + [np.ones(68), np.zeros(68), np.zeros(68)], axis=1),
            SCHEME: read_table("ict")[0],
        },
        regions={
            "narrow_face": np.arange(NARROW_FACE, dtype=np.int32),
            "face": np.arange(FACE, dtype=np.int32),
            "skin": np.arange(SKIN_END, dtype=np.int32),
            "eye_left": np.arange(_EYES[0][0], _EYES[0][1], dtype=np.int32),
            "eye_right": np.arange(_EYES[1][0], _EYES[1][1], dtype=np.int32),
        },
    )


def _turn_eyeballs(vertices: np.ndarray, names: tuple[str, ...], basis: np.ndarray) -> None:
    """Let the eyeballs look where the lids of the eyeLook shapes do; as published, turning them is
    left to a rig.
    """
    for name, rotation in gaze_rotations().items():
        if name not in names:
            continue
        start, end = _EYES[0 if name.endswith("_L") else 1]
        ball = vertices[start:end].astype(np.float64)
        # The sphere through the sclera's back half; in front the cornea bulges.
        sclera = ball[:_SCLERA]
        back = sclera[sclera[:, 2] < np.median(sclera[:, 2])]
        sphere = np.column_stack([2 * back, np.ones(len(back))])
        middle = np.linalg.lstsq(sphere, (back**2).sum(axis=1), rcond=None)[0][:3]
        turned = (ball - middle) @ Rotation.from_rotvec(rotation).as_matrix().T + middle
        basis[names.index(name), start:end] += (turned - ball).astype(np.float32)


def _parts_and_atlas(texture: np.ndarray, polygon_uvs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Part of each polygon, and the UV points moved from their tiles to one atlas."""
    part = np.zeros(len(polygon_uvs), np.uint8)
    uvs = np.zeros_like(texture, dtype=np.float32)
    starts = [tile[0] for tile in _TILES] + [len(polygon_uvs)]
    for (start, label, corner, scale), end in zip(_TILES, starts[1:], strict=True):
        part[start:end] = label
        used = np.unique(polygon_uvs[start:end])
        used = used[used >= 0]
        uvs[used] = np.array(corner) + scale * (texture[used] % 1.0)
    return part, uvs


def _albedo(
    vertices: np.ndarray, polygons: np.ndarray, part: np.ndarray, jaw: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Skin from melanin and haemoglobin harmonics (the model brings none); fixed colors
    elsewhere. ``jaw`` (n, 3): how the vertices move when it opens.
    """
    quads = polygons[part == SKIN]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    skin = np.zeros(len(vertices), bool)
    skin[:SKIN_END] = True
    mean, basis = albedo_basis(vertices, triangles, skin)
    for label, color in PART_ALBEDO.items():
        used = np.unique(polygons[part == label])
        used = used[(used >= 0) & ~skin[used]]
        mean[used] = color
    if jaw is not None:
        used = (np.unique(polygons[of]) for of in (_GUMS_AND_TONGUE, part == TEETH))
        inside, teeth = (each[each >= 0] for each in used)
        moved = np.linalg.norm(jaw[inside], axis=1)
        mean[inside] = mouth_colors(vertices[inside], vertices[teeth], moved)
    # The outer shell is opaque here, so the iris is painted on its cornea.
    for start, end in _EYES:
        mean[start:end] = eyeball_colors(vertices[start:end])
    return mean.astype(np.float32), basis.astype(np.float32)
