"""Several faces in one scene: which there are beside the one that is shown, and each in its own
light.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import bpy

from ..properties import OfFace, StoredFace

# On a collection: it says what a stage lights, or what does not shade what it lights.
RECEIVERS, BLOCKERS = "facestage_receivers", "facestage_blockers"
# On a collection: it is what the Asset Browser shows of a face.
ASSET = "facestage_asset"
_NAMES = {RECEIVERS: "{} in Its Light", BLOCKERS: "Beside {}"}


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


def home(item: bpy.types.Object) -> bpy.types.Collection:
    """The collection that an object lies in, of those that do not only say what lights it; the
    asset it is part of only where there is no other, as in a file that it was brought into.
    """
    found = [
        each for each in item.users_collection if RECEIVERS not in each and BLOCKERS not in each
    ]
    return min(found, key=lambda each: ASSET in each)


def asset_collection(item: bpy.types.Object) -> bpy.types.Collection | None:
    """The collection that is the asset of a face, or None."""
    return next((each for each in item.users_collection if ASSET in each), None)


def link_beside(item: bpy.types.Object, fresh: bpy.types.Object) -> None:
    """Put what belongs to an object where that lies, and into the asset that it is part of."""
    for collection in {home(item), asset_collection(item)} - {None}:
        collection.objects.link(fresh)


def separate_light(scene: bpy.types.Scene) -> None:
    """Let each of several faces be lit by its own stage alone, which lights nothing else and is not
    in the other faces' shade: their fits knew nothing of each other. With one face the stage lights
    all.
    """
    settings = scene.facestage
    faces = [settings, *other_faces(scene)]
    for face in (each for each in faces if each.stage is not None):
        rig = face.rig if settings.faces else None
        beside = [each.rig for each in faces if each.rig not in (None, rig)]
        _link(face, "receiver_collection", RECEIVERS, [rig])
        _link(face, "blocker_collection", BLOCKERS, beside if rig is not None else [])
    for unused in [
        each
        for each in bpy.data.collections
        if (RECEIVERS in each or BLOCKERS in each) and not each.users
    ]:
        bpy.data.collections.remove(unused)


def _link(face: OfFace, role: str, mark: str, rigs: Sequence[bpy.types.Object | None]) -> None:
    """Let ``rigs`` alone be lit by a face's stage (RECEIVERS), or all but these shade it
    (BLOCKERS); without any, all that there is does.
    """
    lights = [each for each in face.stage.children_recursive if each.type == "LIGHT"]
    found = {getattr(each.light_linking, role) for each in lights} - {None}
    ours = [each for each in found if each.get(mark)]
    wanted = {item for rig in rigs if rig is not None for item in (rig, *rig.children_recursive)}
    if not wanted:
        for light in lights:
            if getattr(light.light_linking, role) in ours:
                setattr(light.light_linking, role, None)
        return
    linked = ours[0] if ours else bpy.data.collections.new(_NAMES[mark].format(face.rig.name))
    linked[mark] = True
    for item in set(linked.objects) - wanted:
        linked.objects.unlink(item)
    for item in wanted - set(linked.objects):
        linked.objects.link(item)
    for member in linked.collection_objects if mark == BLOCKERS else ():
        member.light_linking.link_state = "EXCLUDE"
    for light in lights:
        setattr(light.light_linking, role, linked)
