"""Light below the skin: how far it wanders, shared by the fit and the Blender material.

Irradiance comes out again around where it went in, spread by the profile of Christensen and Burley
2015 (Approximate Reflectance Profiles for Efficient Subsurface Scattering), whose integral is 1:

R(r) = (exp(-r / d) + exp(-r / (3 d))) / (8 pi d r)

It is that of Cycles' "Christensen-Burley" with a radius of 4 pi d. A strength of 1 is what Cycles'
"Random Walk (Skin)" makes of the mean free paths RADIUS_MM that Jensen et al. 2001 (A Practical
Model for Subsurface Light Transport) measured of "skin 1", in light skin: beside the edge of a
shadow on a plane of albedo c its d is (0.34 - 0.46 c + 0.17 c^2) times the radius.

Light that went on below the skin also comes out unevenly: more at a slant than straight up, and
more where the surface bulges than where it is hollow. Skin of albedo a, of which c = K_DIFFUSE a of
all light comes out, seen at the cosine m to its normal, of mean curvature H (1 / m, convex
positive), sends times what opaque skin does

1 + (1 - c) (SLANT (2/3 - m) + BULGE d H)

SLANT and BULGE are what fits Cycles' "Random Walk (Skin)" best: SLANT on a sphere a thousand times
as large as the mean free path, of c from 0.1 to 0.8 (about half of what a half-space of isotropic
scatterers has behind a rough boundary, Chandrasekhar 1960, Radiative Transfer), BULGE on faces.
Over all directions SLANT leaves as much light as there is.
"""

from typing import Any

from facestage.contract.brdf import K_DIFFUSE

METRES = 1e-3
RADIUS_MM = (3.67, 1.37, 0.68)  # red, green, blue
DISTANCE_MM = (0.58, 0.29, 0.16)  # d; c = 0.46, 0.30, 0.23
STRENGTH_MAX, TRANSLUCENCY_MAX = 4.0, 2.0  # of results
SLANT, BULGE = 0.28, 4.0
BULGE_M = tuple(BULGE * METRES * each for each in DISTANCE_MM)  # BULGE d by channel
MEAN_COSINE = 2.0 / 3.0  # of light that leaves a matte surface
CURVATURE_MAX = 150.0  # 1 / m; what bends more is smaller than light wanders


def emerging(albedo: Any, excess: Any) -> Any:
    """How much more than opaque skin sends comes out of skin; ``excess`` the sum of SLANT and BULGE
    terms. Numbers or arrays.
    """
    return 1.0 + (1.0 - K_DIFFUSE * albedo) * excess
