"""A GNM head of the published structure (every key and name that its readers use), on a head made
for tests.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from reference.published.heads import ball, head, smooth_modes

IDENTITY = ("head", "eyes", "teeth")
EXPRESSIONS = ("left_eye_region", "right_eye_region", "lower_face_region", "tongue", "pupils")
EYE_RADIUS = 0.012


def gnm_arrays(count: int = 900, seed: int = 0) -> dict[str, np.ndarray]:
    """The entries of gnm_head.npz: a head of ``count`` vertices and the middles of its edges and
    triangles.
    """
    skin = head(count, ring=60)
    marks = skin.landmarks
    centres = [marks[k : k + 6].mean(axis=0) - [0, 0, EYE_RADIUS - 0.003] for k in (42, 36)]
    mouth = marks[48:].mean(axis=0)
    pieces = [("skin", skin.vertices, skin.triangles)]
    for side, centre in zip(("left", "right"), centres, strict=True):
        pieces.append((f"{side}_eye", *ball(200, EYE_RADIUS, centre)))
        pieces.append((f"{side}_cornea", *ball(120, EYE_RADIUS * 1.05, centre)))
    for name, lift in (("upper_teeth_and_gums", 0.006), ("lower_teeth_and_gums", -0.006)):
        pieces.append((name, *ball(80, 0.008, mouth + np.array([0, lift, -0.02]))))
    pieces.append(("tongue", *ball(80, 0.008, mouth - [0, 0, 0.03])))
    start, owner, vertices, quads = 0, [], [], []
    for name, points, triangles in pieces:
        places, rows = _quads(points, triangles)
        vertices.append(places)
        owner += [name] * len(places)
        quads.append(rows + start)
        start += len(places)
    place, faces, names = np.concatenate(vertices), np.concatenate(quads), np.array(owner)
    eye = np.char.endswith(names, "_eye") | np.char.endswith(names, "_cornea")
    groups = {
        "skin": names == "skin",
        "left_eye": np.char.startswith(names, "left_") & eye,
        "right_eye": np.char.startswith(names, "right_") & eye,
        "eyes": eye,
        "eye_exteriors": np.char.endswith(names, "_cornea"),
        "eye_interiors": np.char.endswith(names, "_eye"),
        "upper_teeth_and_gums": names == "upper_teeth_and_gums",
        "lower_teeth_and_gums": names == "lower_teeth_and_gums",
        "tongue": names == "tongue",
        "teeth": np.char.endswith(names, "_gums"),
        "mouth_sock": np.zeros(len(names), bool),
        "hockey_mask": (names == "skin") & (place[:, 2] > -0.02),
    }
    front = np.zeros(len(names))
    for side, centre in zip(("left", "right"), centres, strict=True):
        rows = names == f"{side}_eye"
        front[rows] = (place[rows, 2] - centre[2]) / EYE_RADIUS
    groups |= {
        "irises": front > 0.87,
        "pupils": front > 0.97,
        "scleras": groups["eye_interiors"] & (front <= 0.87),
    }
    joints = np.array([[0, -0.14, -0.06], [0, -0.08, -0.05], *centres])
    weights = np.zeros((4, len(names)))
    weights[2], weights[3] = groups["left_eye"], groups["right_eye"]
    weights[1] = ~eye * np.clip((place[:, 1] + 0.14) / 0.04, 0, 1)
    weights[0] = 1 - weights.sum(axis=0)
    random = np.random.default_rng(seed)
    identity = smooth_modes(place, 8, 2.5e-3, seed)
    expression = smooth_modes(place, 7, 1.5e-3, seed + 1)
    expression[:, eye] = 0
    uvs = np.clip(0.5 + 2.0 * (place[:, :2] - place[:, :2].mean(0)), 0, 1)
    triangles = np.concatenate([faces[:, :3], faces[:, [2, 3, 0]]])
    return {
        "version": np.array("3.0"),
        "variant": np.array("head"),
        "template_vertex_positions": place.astype(np.float32),
        "template_joint_positions": joints.astype(np.float32),
        "vertex_identity_basis": identity,
        "joint_identity_basis": np.zeros((8, 4, 3), np.float32),
        "expression_basis": expression,
        "identity_names": np.array([f"{IDENTITY[k % 3]}_{k:03d}" for k in range(8)]),
        "joint_names": np.array(["neck", "head", "left_eye", "right_eye"]),
        "expression_names": np.array([f"{EXPRESSIONS[k % 5]}_{k:03d}" for k in range(7)]),
        "joint_parent_indices": np.array([0, 0, 1, 1], np.int32),
        "skinning_weights": weights.astype(np.float32),
        "quads": faces.astype(np.int32),
        "triangles": triangles.astype(np.int32),
        "quad_uvs": uvs[faces].astype(np.float32),
        "triangle_uvs": uvs[triangles].astype(np.float32),
        "mesh_component_names": np.array(list(dict.fromkeys(owner))),
        "mirror_indices": np.arange(len(names)),
        "joint_regressor": np.zeros((4, len(names)), np.float32),
        "pose_correctives_regressor": (1e-4 * random.normal(size=(36, 3 * len(names)))).astype(
            np.float32
        ),
        "bone_aligned_template_joint_orientations": np.tile(np.eye(3, dtype=np.float32), (4, 1, 1)),
        "vertex_groups": np.stack(list(groups.values())).astype(np.float32),
        "vertex_group_names": np.array(list(groups)),
    }


def write_landmarks(path: Path, count: int = 900, shuffled_jaw: bool = False) -> np.ndarray:
    """head_sparse_68.txt; the places (68, 3) in the ibug order.

    ``shuffled_jaw``: as some versions have it.
    """
    skin = head(count, ring=60)
    corners = skin.triangles[skin.landmark_triangle]
    rows = np.stack([corners, skin.landmark_weights], axis=-1).reshape(68, 6)
    if shuffled_jaw:
        rows = rows[[0, 1, 6, 5, 4, 3, 2, *range(7, 68)]]
    np.savetxt(path, rows, fmt=["%d", "%.6f"] * 3)
    return skin.landmarks


def _quads(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface as quads, three for each triangle: its vertices, then the middles of its edges
    and triangles.
    """
    start, end = triangles, np.roll(triangles, -1, axis=1)
    edges, row = np.unique(
        np.sort(np.stack([start, end], axis=-1).reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    middle = len(points) + row.reshape(triangles.shape)
    inside = len(points) + len(edges) + np.arange(len(triangles))
    quads = [
        np.stack([triangles[:, k], middle[:, k], inside, middle[:, k - 1]], axis=1)
        for k in range(3)
    ]
    places = np.concatenate([points, points[edges].mean(axis=1), points[triangles].mean(axis=1)])
    return places, np.concatenate(quads)
