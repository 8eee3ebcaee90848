"""Light below the skin: how far it wanders, shared by the fit and the Blender material.

Irradiance comes out again around where it went in, spread by the profile of Christensen and Burley
2015 (Approximate Reflectance Profiles for Efficient Subsurface Scattering), whose integral is 1:

R(r) = (exp(-r / d) + exp(-r / (3 d))) / (8 pi d r)

It is that of Cycles' "Christensen-Burley" with a radius of 4 pi d. A strength of 1 is what Cycles'
"Random Walk (Skin)" makes of the mean free paths RADIUS_MM that Jensen et al. 2001 (A Practical
Model for Subsurface Light Transport) measured of "skin 1", in light skin: beside the edge of a
shadow on a plane of albedo c its d is (0.34 - 0.46 c + 0.17 c^2) times the radius.
"""

METRES = 1e-3
RADIUS_MM = (3.67, 1.37, 0.68)  # red, green, blue
DISTANCE_MM = (0.58, 0.29, 0.16)  # d; c = 0.46, 0.30, 0.23
STRENGTH_MAX = 4.0
