"""The skin's reflectance, shared by the fit, the renderer and the Blender material.

f = K_DIFFUSE * albedo / pi + K_SPECULAR * c_spec * D(h) G(l, v) F(v, h) / (4 (n.l)(n.v))

with GGX D (alpha = roughness^2), height-correlated Smith G and Schlick F (Cook & Torrance 1982,
Walter et al. 2007, Heitz 2014).
"""

import math
from typing import Any

F0 = 0.04  # reflectance at normal incidence of a dielectric of index 1.5

# A smooth dielectric of index 1.5 reflects 9.2 % of uniform light (Egan & Hilgeman 1979); only what
# is not reflected enters the skin. A constant keeps the sum reciprocal, and a white-lit face
# conserves energy for every albedo <= 1 and c_spec <= 1.
K_DIFFUSE = 0.908
K_SPECULAR = 1.0

ROUGHNESS_MIN, ROUGHNESS_MAX = 0.05, 1.0
SPECULAR_MAX = 2.0  # c_spec beyond twice a dielectric's is metal, not skin
ALBEDO_MAX = 0.999


def matte(albedo: Any, irradiance: Any) -> Any:
    """Radiance from below the surface, linear in both; numbers, arrays or Dr.Jit's.

    ``irradiance`` is the integral of (n.l); for one direction of light, (n.l) itself.
    """
    return K_DIFFUSE / math.pi * albedo * irradiance


def gloss(c_spec: Any, lobe: Any) -> Any:
    """Radiance from the surface, linear in both; ``lobe`` is (n.l) D V F, V = G / (4 (n.l)(n.v)),
    or its integral.
    """
    return K_SPECULAR * c_spec * lobe
