"""The skin of a scan, in a scene of metres."""

from __future__ import annotations

import numpy as np
import pytest


def test_light_wanders_as_far_as_in_skin(scene) -> None:
    """Jensen et al. 2001, table of materials, skin 1: 1 / (absorption + reduced scattering), mm."""
    from facestage_blender.synthetic.scans.skin import SkinMaps, skin_material

    inputs = skin_material(SkinMaps()).node_tree.nodes["Principled BSDF"].inputs
    absorption, scattering = np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01])
    transport = np.sqrt(3 * absorption * (absorption + scattering))
    metres = inputs["Subsurface Scale"].default_value * np.array(
        inputs["Subsurface Radius"].default_value
    )
    assert 1e3 * metres == pytest.approx(1 / transport, rel=0.01)
    assert inputs["Subsurface Weight"].default_value == 1.0
