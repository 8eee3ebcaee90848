"""The default face model: an adult head modelled by code from published anthropometry and skin
optics.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from facestage.contract.face_model import FaceModel
from facestage.models.anatomy.shipped_landmarks import SCHEME, read_table
from facestage.models.anatomy.skin import albedo_basis
from facestage.models.head import coloring, eyes, mouth
from facestage.models.head.assemble import SIDES, HeadMesh, assemble
from facestage.models.head.caruncle import flesh
from facestage.models.head.ear_height import ears_lowered
from facestage.models.head.expressions import expressions
from facestage.models.head.face_form import face_form
from facestage.models.head.identity import identity_modes
from facestage.models.head.landmarks import ibug68
from facestage.models.head.masks import Masks
from facestage.models.head.neutral import neutral_shift
from facestage.models.head.sculpt import sculpted
from facestage.models.head.variation import mixing

NAME = "default"
ALBEDO_MODES = 80
FLESH_PALE = 0.8  # share of the skin's pigment that the flesh in the corners of the eyes lacks
_MM = 1e-3


@cache
def build_default_model() -> FaceModel:
    """The default head: 80 identity modes, 90 expressions, 80 albedo modes, in the model frame
    (metres).

    Deterministic and cached; the arrays are read-only.
    """
    mesh = assemble()
    masks = Masks(mesh)
    identity_names, identity = identity_modes(masks)
    expression_names, expression = expressions(masks)
    regions = _regions(mesh, masks)
    narrow = regions["narrow_face"]
    plain = (mesh.vertices - mesh.vertices[narrow].mean(axis=0) * [0, 1, 1]) * _MM
    shift = neutral_shift(identity_names, identity) + face_form(masks.count)
    identity = np.tensordot(mixing(identity_names), identity, 1)
    origin = (mesh.vertices + shift)[narrow].mean(axis=0) * [0, 1, 1]
    vertices = (sculpted(mesh) + shift - origin) * _MM
    _, basis = albedo_basis(plain, mesh.triangles, regions["skin"], ALBEDO_MODES)
    basis *= 1 - FLESH_PALE * flesh(mesh)[None, :, None].astype(np.float32)
    # The jaw's first ones lie beside the ears, and not on what moved with them.
    landmark = ibug68(replace(mesh, vertices=ears_lowered(mesh, mesh.vertices)))
    weights = np.tile([1.0, 0.0, 0.0], (68, 1))
    arrays = {
        "vertices": vertices.astype(np.float32),
        "polygons": mesh.polygons,
        "polygon_uvs": mesh.polygon_uvs,
        "polygon_part": mesh.polygon_part,
        "uvs": mesh.uvs.astype(np.float32),
        "identity_basis": (identity * _MM).astype(np.float32),
        "expression_basis": (expression * _MM).astype(np.float32),
        "albedo_mean": np.clip(coloring.mean_albedo(mesh, masks), 0.004, 0.95).astype(np.float32),
        "albedo_basis": basis,
    }
    landmarks = {
        "ibug68": np.concatenate([np.repeat(landmark[:, None], 3, axis=1), weights], axis=1),
        SCHEME: read_table("default")[0],
    }
    for array in (*arrays.values(), *landmarks.values(), *regions.values()):
        array.setflags(write=False)
    return FaceModel(
        name=NAME,
        license="GPL-3.0-or-later",
        source="Facestage: modelled by code from published anthropometry and means of ICT-FaceKit",
        identity_names=identity_names,
        expression_names=expression_names,
        expression_prior="box",
        landmarks=landmarks,
        regions=regions,
        **arrays,
    )


def _regions(mesh: HeadMesh, masks: Masks) -> dict[str, np.ndarray]:
    """Named vertex sets; mm frame of the control net."""
    x, y, z = masks.points.T
    lip_border = len(mouth.OUTER_LOOPS) + 1
    behind_lips = np.zeros(masks.count, bool)
    behind_lips[mesh.loops["mouth"][mouth.LIP_LOOPS + 1 :]] = True
    behind_lids = np.zeros(masks.count, bool)
    for side in SIDES:
        behind_lids[mesh.loops[f"eye_{side}"][eyes.MARGIN + 1 :]] = True
    visible = masks.skin & ~behind_lips & ~behind_lids
    # Chin to brows, and sideways to the outer corners of the eyes.
    narrow = visible & (z > 45) & (np.abs(x) < 50) & (y < 27) & (y > -112 - 0.25 * (84 - z).clip(0))
    face = visible & (z > 2) & (y < 68) & (y > -118 + 0.42 * (78 - z).clip(0))
    ears = np.zeros(masks.count, bool)
    for side in SIDES:
        ears[mesh.loops[f"ear_{side}"][2:]] = True
    hair = coloring.hair_weight(masks) > 0.5
    neck = visible & (y < -112 + 0.5 * (84 - z).clip(0)) & ~face & ~hair & ~ears
    masked = {
        "narrow_face": narrow,
        "face": face & ~ears,
        "skin": masks.skin,
        "scalp": hair,
        "neck": neck,
        "ears": ears,
        "brows": coloring.brow_weight(masks) > 0.4,
        "eye_corners": flesh(mesh) > 0.5,
    }
    regions = {name: np.flatnonzero(mask).astype(np.int32) for name, mask in masked.items()}
    regions["lips"] = np.unique(mesh.loops["mouth"][lip_border : mouth.LIP_LOOPS + 1]).astype(
        np.int32
    )
    for side in SIDES:
        regions[f"eye_{side}"] = np.sort(mesh.eyeballs[side]).astype(np.int32)
    return regions
