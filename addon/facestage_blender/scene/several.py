"""Several faces in one scene: which there are beside the one that is shown, and each in its own
light.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..properties import OfFace, StoredFace

RECEIVERS = "facestage_receivers"  # on a collection: it says what a stage lights


def other_faces(scene: bpy.types.Scene) -> Iterator[StoredFace]:
    """The faces of the scene that are not shown."""
    settings = scene.facestage
    for number, face in enumerate(settings.faces, 1):
        if number != settings.face_shown:
            yield face


def shares_camera(scene: bpy.types.Scene) -> bool:
    """Whether another face was fitted in the camera's picture: then it is the stage that moves."""
    camera = scene.camera
    return camera is not None and any(
        face.camera == camera and face.result for face in other_faces(scene)
    )


def separate_light(scene: bpy.types.Scene) -> None:
    """Let each of several faces be lit by its own stage alone, which lights nothing else; with one
    face the stage lights all.
    """
    settings = scene.facestage
    for face in (settings, *other_faces(scene)):
        if face.stage is not None:
            _light(face, face.rig if settings.faces else None)
    for unused in [each for each in bpy.data.collections if RECEIVERS in each and not each.users]:
        bpy.data.collections.remove(unused)


def _light(face: OfFace, rig: bpy.types.Object | None) -> None:
    """Let a face's stage light ``rig`` alone; None: all that there is."""
    lights = [each for each in face.stage.children_recursive if each.type == "LIGHT"]
    found = {each.light_linking.receiver_collection for each in lights} - {None}
    ours = [each for each in found if each.get(RECEIVERS)]
    if rig is None:
        for light in lights:
            if light.light_linking.receiver_collection in ours:
                light.light_linking.receiver_collection = None
        return
    lit = ours[0] if ours else bpy.data.collections.new(f"{rig.name} in Its Light")
    lit[RECEIVERS] = True
    wanted = {rig, *rig.children_recursive}
    for item in set(lit.objects) - wanted:
        lit.objects.unlink(item)
    for item in wanted - set(lit.objects):
        lit.objects.link(item)
    for light in lights:
        light.light_linking.receiver_collection = lit
