"""The skin's reflectance and its derivatives, as Dr.Jit expressions (constants:
contract/brdf.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from facestage.contract.brdf import F0

# Interpolated normals may face away from the viewer at the silhouette; the model ends at grazing
# view.
MIN_VIEW_COSINE = 1e-3


@dataclass(frozen=True)
class SpecularLobe:
    """g = (n.l) D V F and its partial derivatives, V = G / (4 (n.l)(n.v))."""

    value: Any
    by_nl: Any
    by_nv: Any
    by_nh: Any
    by_vh: Any
    by_roughness: Any


def specular_lobe(
    nl: Any, nv: Any, nh2_complement: Any, nh: Any, vh: Any, roughness: Any
) -> SpecularLobe:
    """Cook-Torrance times (n.l): GGX, height-correlated Smith (Heitz 2014, eq. 99), Schlick.

    ``nh2_complement`` is 1 - (n.h)^2 computed as |n x h|^2: in float32 the difference itself
    loses every digit of a sharp highlight. No facet faces below the surface (Walter et al. 2007,
    eq. 33): half vectors get there where an interpolated normal faces away from the viewer, and
    |n x h|^2 has a second peak opposite the normal.
    """
    a2 = dr.square(dr.square(roughness))
    denominator = dr.maximum(a2 * nh * nh + nh2_complement, 1e-12)
    d = dr.select(nh > 0, a2 / (dr.pi * dr.square(denominator)), 0)
    root_v = dr.sqrt(nv * nv * (1 - a2) + a2)
    root_l = dr.sqrt(nl * nl * (1 - a2) + a2)
    v = 0.5 / (nl * root_v + nv * root_l)
    schlick = dr.square(dr.square(1 - vh)) * (1 - vh)
    f = F0 + (1 - F0) * schlick

    dv = -2 * v * v  # dV/dQ for V = 1 / (2 Q)
    v_by_nl = dv * (root_v + nv * nl * (1 - a2) / root_l)
    v_by_nv = dv * (nl * nv * (1 - a2) / root_v + root_l)
    v_by_a2 = dv * 0.5 * (nl * (1 - nv * nv) / root_v + nv * (1 - nl * nl) / root_l)
    d_by_nh = d * -4 * nh * (a2 - 1) / denominator
    d_by_a2 = d * (1 / a2 - 2 * nh * nh / denominator)
    return SpecularLobe(
        value=nl * d * v * f,
        by_nl=d * f * (v + nl * v_by_nl),
        by_nv=nl * d * f * v_by_nv,
        by_nh=nl * v * f * d_by_nh,
        by_vh=nl * d * v * -5 * (1 - F0) * dr.square(dr.square(1 - vh)),
        by_roughness=nl * f * (d_by_a2 * v + d * v_by_a2) * 4 * roughness * roughness * roughness,
    )


def view_cosine(normal: mi.Vector3f, view: mi.Vector3f) -> Any:
    """n.v, kept away from zero."""
    return dr.maximum(dr.dot(normal, view), MIN_VIEW_COSINE)


@dataclass(frozen=True)
class HalfVector:
    """The direction between those to light and viewer."""

    direction: Any  # Vector3f, unit
    inverse_length: Any  # Float, of the sum of both unit vectors

    @classmethod
    def between(cls, light: Any, view: Any) -> HalfVector:
        """Of two unit vectors."""
        total = light + view
        inverse_length = dr.rsqrt(dr.maximum(dr.squared_norm(total), 1e-12))
        return cls(total * inverse_length, inverse_length)


def lobe_about(
    half: HalfVector, normal: Any, view: Any, nl: Any, nv: Any, roughness: Any
) -> SpecularLobe:
    """The lobe at a point of that ``normal``, ``nl`` = n.l of any sign, ``nv`` from
    :func:`view_cosine`.
    """
    h = half.direction
    nh, vh = dr.maximum(dr.dot(normal, h), 0), dr.clip(dr.dot(view, h), 0, 1)
    complement = dr.squared_norm(dr.cross(normal, h))
    return specular_lobe(dr.maximum(nl, 0), nv, complement, nh, vh, roughness)
