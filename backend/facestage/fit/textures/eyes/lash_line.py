"""The dark line of the lashes along the upper lid's border, on the skin.

It is half a millimetre to a millimetre and a half wide, in a photo a pixel or two, beside the gap
between lid and eyeball, where a fitted mesh is off by as much: texels of the photo leave it out,
and an eye without it looks bare. Where it runs, landmarks of the face model know; how dark it is,
the photo says along its own (lash_depth.py).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float, Float32
from facestage.contract.face_model import EYES, FaceModel
from facestage.fit.textures.atlas import Atlas
from facestage.models.anatomy.landmark_schemes import scheme_of

SCHEME = "mediapipe478"
# Metres: how far the line goes on the lid, and on its rim, which lashes hide; and where skin is
# that of the lid.
HALF_WIDTH, RIM, LID_SKIN = 0.0014, 0.003, (0.0022, 0.004)
ON_EYEBALL = 0.002  # from it a lid's border lies, the most
STEP = 0.0001  # between points of the border
# Share of the way from the inner corner over which the line begins.
BEGINS = (0.08, 0.35)


def upper_borders(
    model: FaceModel,
) -> list[tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, " points"]]]:
    """Of each eye points of the upper lid's border on the mean face, and how much of a line of
    lashes is there, 0..1; nothing for models that do not know the border, or whose landmarks, made
    for another mesh, do not lie where lids meet eyeballs.
    """
    eyeballs = np.unique(model.triangles[model.triangle_part == EYES])
    if SCHEME not in model.landmarks or not len(eyeballs):
        return []
    eyeball = cKDTree(model.vertices[eyeballs])
    vertices, weights = model.landmark_vertices(SCHEME)
    result = []
    for number, eye in enumerate(scheme_of(SCHEME).eyes):
        inner = eye.corners[1 - number]  # the first eye is the picture's left one
        at = np.array([*eye.corners, *(pair[0] for pair in eye.lids)])
        points = np.einsum("mi,mix->mx", weights[at], model.vertices[vertices[at]])
        from_inner = np.abs(points[:, 0] - points[list(at).index(inner), 0])
        points = points[np.argsort(from_inner)]
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        if np.median(eyeball.query(points)[0]) > ON_EYEBALL:
            continue
        along = np.arange(0.0, length[-1], STEP)
        line = np.stack([np.interp(along, length, each) for each in points.T], axis=1)
        share = (along / length[-1] - BEGINS[0]) / (BEGINS[1] - BEGINS[0])
        result.append((line, np.clip(share, 0.0, 1.0)))
    return result


def draw_lash_line(
    log_albedo: Float32[np.ndarray, "size size 3"],
    atlas: Atlas,
    model: FaceModel,
    mean: Float[np.ndarray, "vertices 3"],
    depth: float,
) -> None:
    """Darken the ``log_albedo`` of an atlas along the upper lids' borders by ``depth``.

    What is as dark there already stays. ``mean``: the rendered mesh's vertices on the mean face.
    """
    borders = upper_borders(model) if depth > 0 else []
    if not borders:
        return
    low = np.min([line.min(axis=0) for line, _ in borders], axis=0) - LID_SKIN[1]
    high = np.max([line.max(axis=0) for line, _ in borders], axis=0) + LID_SKIN[1]
    corners = mean[atlas.triangles]
    near = atlas.on(((corners.max(axis=1) > low) & (corners.min(axis=1) < high)).all(axis=1))
    place, texel = atlas.at(near, mean), atlas.place(near)
    within = ((place > low) & (place < high)).all(axis=1) & atlas.skin.ravel()[texel]
    place, texel = place[within], texel[within]
    values = log_albedo.reshape(-1, 3)
    for line, share in borders:
        distance, nearest = cKDTree(line).query(place, distance_upper_bound=LID_SKIN[1])
        here = np.isfinite(distance)
        own, away, strength = texel[here], distance[here], share[nearest[here]]
        above = place[here, 1] > line[nearest[here], 1]
        lid = above & (away > LID_SKIN[0])
        if not lid.any():
            continue
        usual = float(np.median(values[own[lid]].mean(axis=1)))
        already = np.maximum(usual - values[own].mean(axis=1), 0.0)
        wide = np.where(above, HALF_WIDTH, RIM)
        wanted = depth * strength * np.exp(-((away / wide) ** 4))
        values[own] -= np.maximum(wanted - already, 0.0)[:, None]
