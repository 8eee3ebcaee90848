"""The constants of the skin's reflectance, shared by the fit and the Blender material.

f = K_DIFFUSE * albedo / pi + K_SPECULAR * c_spec * D(h) G(l, v) F(v, h) / (4 (n.l)(n.v))

with GGX D (alpha = roughness^2), height-correlated Smith G and Schlick F (Cook & Torrance 1982,
Walter et al. 2007, Heitz 2014).
"""

F0 = 0.04  # reflectance at normal incidence of a dielectric of index 1.5

# A smooth dielectric of index 1.5 reflects 9.2 % of uniform light (Egan & Hilgeman 1979); only what
# is not reflected enters the skin. A constant keeps the sum reciprocal, and a white-lit face
# conserves energy for every albedo <= 1 and c_spec <= 1.
K_DIFFUSE = 0.908
K_SPECULAR = 1.0

ROUGHNESS_MIN, ROUGHNESS_MAX = 0.05, 1.0
SPECULAR_MAX = 2.0  # c_spec beyond twice a dielectric's is metal, not skin
ALBEDO_MAX = 0.999
