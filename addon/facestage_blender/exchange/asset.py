"""The face as an asset: a collection of its rig and all that belongs to it, which the Asset Browser
shows and other .blend files take as a whole.

The collection is in no scene: the objects stay where they lie.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.result import Result

from ..pictures.render import read_pixels
from ..rig.face_rig import require_rig
from ..rig.model_kinds import KINDS, rig_license
from ..scene.paths import absolute
from ..scene.several import ASSET, asset_collection
from ..translations import said

FACE_PICTURE = "face.png"  # of a result: the fit in its place in the photo
PREVIEW_SIDE = 256  # pixels, as Blender's own previews
OF_THE_STAGE = ("LIGHT", "CAMERA")


def mark_as_asset(scene: bpy.types.Scene, name: str = "") -> bpy.types.Collection:
    """Make the scene's face an asset of the file, called ``name`` or as its rig, and return its
    collection.

    What grows on the rig later comes into it, too. The author is left to the user. Raises
    InputError when there is no face.
    """
    rig = require_rig(scene)
    for layer in scene.view_layers:
        layer.update()  # a script may have moved the rig just now
    collection = asset_collection(rig) or bpy.data.collections.new(rig.name)
    collection[ASSET] = True
    if name:
        collection.name = name
    for item in set(_members(rig)) - set(collection.objects):
        collection.objects.link(item)
    collection.instance_offset = rig.matrix_world.translation  # the head comes to the mouse
    collection.asset_mark()
    result = _result(scene, rig)
    _describe(collection, rig, result)
    if result is not None:
        _show(collection, result)
    return collection


def asset_of(rig: bpy.types.Object) -> bpy.types.Collection | None:
    """The collection that is the rig's asset, or None."""
    collection = asset_collection(rig)
    return None if collection is None or collection.asset_data is None else collection


def clear_asset(rig: bpy.types.Object) -> None:
    """Let the rig's face be no asset, if it is one; its objects stay."""
    collection = asset_collection(rig)
    if collection is not None:
        collection.asset_clear()
        bpy.data.collections.remove(collection)


def _members(rig: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The rig, what grows on it, and what carries it: a control rig, the stage's empty, without
    which it would stand elsewhere.
    """
    carriers, above = [], rig.parent
    while above is not None:
        carriers.append(above)
        above = above.parent
    for item in (*carriers, rig, *rig.children_recursive):
        if item.type not in OF_THE_STAGE:
            yield item


def _result(scene: bpy.types.Scene, rig: bpy.types.Object) -> Result | None:
    """The result that the scene's face shows; None where it was not fitted or its folder is gone:
    the face is in the .blend.
    """
    if scene.facestage.result:
        with suppress(InputError):
            result = Result.load(absolute(scene.facestage.result))
            return result if result.model == rig.facestage_face.model else None
    return None


def _describe(
    collection: bpy.types.Collection, rig: bpy.types.Object, result: Result | None
) -> None:
    """Description, tags and license. The license of a mesh of the user's is theirs to say."""
    kind = KINDS.get(rig.facestage_face.model.partition(":")[0])
    model = kind.label if kind is not None else rig.facestage_face.model
    about = collection.asset_data
    about.description = (
        said("A face, not fitted to a photo.")
        if result is None
        else said("A face fitted to a photo. {advice}", advice=result.advice)
    )
    for tag in ("face", "Facestage", model):
        about.tags.new(tag, skip_if_exists=True)
    if not rig.facestage_face.own_mesh:
        about.license = rig_license(rig)


def _show(collection: bpy.types.Collection, result: Result) -> None:
    """Make the picture of a result the asset's, where it has one."""
    path = Path(result.folder or "") / FACE_PICTURE
    if not is_file(path):
        return
    try:
        read = read_pixels(path)
    except RuntimeError:
        return  # Blender shows its own icon
    if not read.size:  # damaged
        return
    pixels = _preview(read)
    preview = collection.preview_ensure()
    preview.image_size = pixels.shape[1], pixels.shape[0]
    preview.image_pixels_float.foreach_set(pixels[::-1].ravel())


def _preview(pixels: np.ndarray) -> np.ndarray:
    """(PREVIEW_SIDE, PREVIEW_SIDE, 4) opaque float32: the square in the middle of (h, w, 4), each
    pixel the mean of what it covers.
    """
    height, width = pixels.shape[:2]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    square = pixels[top : top + side, left : left + side].astype(np.float64)
    edges = np.linspace(0, side, PREVIEW_SIDE + 1)[:, None]
    cells = np.arange(side)
    covered = np.clip(np.minimum(edges[1:], cells + 1) - np.maximum(edges[:-1], cells), 0, None) * (
        PREVIEW_SIDE / side
    )
    small = np.einsum("ij,jkc,lk->ilc", covered, square, covered, optimize=True)
    small[..., 3] = 1.0
    return small.astype(np.float32)
