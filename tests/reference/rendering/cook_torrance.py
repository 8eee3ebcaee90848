"""The skin's reflectance straight from the papers, one direction pair at a time or broadcast."""

from __future__ import annotations

import numpy as np

from facestage.contract.brdf import F0, K_DIFFUSE, K_SPECULAR


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (np.asarray(a, float) * np.asarray(b, float)).sum(-1)


def normalize(a: np.ndarray) -> np.ndarray:
    return np.asarray(a, float) / np.linalg.norm(a, axis=-1, keepdims=True)


def ggx(cos_h: np.ndarray, alpha: float) -> np.ndarray:
    """D(h), Walter et al. 2007, eq. 33, with tan^2 written through the cosine."""
    tan2 = (1 - cos_h**2) / cos_h**2
    return np.where(cos_h > 0, alpha**2 / (np.pi * cos_h**4 * (alpha**2 + tan2) ** 2), 0.0)


def smith_lambda(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Lambda(v) of GGX, Heitz 2014, eq. 72."""
    tan2 = (1 - cosine**2) / cosine**2
    return 0.5 * (-1 + np.sqrt(1 + alpha**2 * tan2))


def smith(cos_l: np.ndarray, cos_v: np.ndarray, alpha: float) -> np.ndarray:
    """Height-correlated masking and shadowing, Heitz 2014, eq. 99."""
    return 1 / (1 + smith_lambda(cos_l, alpha) + smith_lambda(cos_v, alpha))


def schlick(cos_d: np.ndarray) -> np.ndarray:
    return F0 + (1 - F0) * (1 - cos_d) ** 5


def cook_torrance(
    normal: np.ndarray, light: np.ndarray, view: np.ndarray, roughness: float
) -> np.ndarray:
    """D G F / (4 (n.l)(n.v)) for unit vectors; alpha = roughness^2. Zero below the surface."""
    alpha = roughness**2
    cos_l, cos_v = dot(normal, light), dot(normal, view)
    half = normalize(np.asarray(light) + np.asarray(view))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = (
            ggx(dot(normal, half), alpha) * smith(cos_l, cos_v, alpha) * schlick(dot(view, half))
        )
        value = value / (4 * cos_l * cos_v)
    return np.where((cos_l > 0) & (cos_v > 0), value, 0.0)


def skin(
    normal: np.ndarray,
    light: np.ndarray,
    view: np.ndarray,
    albedo: float,
    c_spec: float,
    roughness: float,
) -> np.ndarray:
    """The whole reflectance f of the design, per channel of a grey albedo."""
    return K_DIFFUSE * albedo / np.pi + K_SPECULAR * c_spec * cook_torrance(
        normal, light, view, roughness
    )
