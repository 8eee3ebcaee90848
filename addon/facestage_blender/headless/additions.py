"""What is not fitted and makes a face stand a close-up, for batch and demo: `--add`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy

ADDITIONS = ("lashes", "brow-hair", "wet-eyes", "pores", "handles")


def add_to_face(scene: bpy.types.Scene, names: Iterable[str]) -> None:
    """Give the scene's face these of ADDITIONS. Raises InputError where its rig can have none."""
    from ..rig.control.control_rig import add_control_rig
    from ..rig.face_rig import require_rig
    from ..scene.several import separate_light
    from ..skin.brows import grow_brows
    from ..skin.lashes import grow_lashes
    from ..skin.pores import give_pores
    from ..skin.wet_eyes import wet_eyes

    rig, wanted = require_rig(scene), set(names)
    if "lashes" in wanted:
        grow_lashes(rig)
    if "brow-hair" in wanted:
        grow_brows(rig)
    if "wet-eyes" in wanted:
        wet_eyes(rig)
    if "pores" in wanted:
        give_pores(rig)
    separate_light(scene)  # what grew has the light of its face
    if "handles" in wanted:
        add_control_rig(scene)
