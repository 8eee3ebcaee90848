"""A performance that was tracked in a film, as keyframes: expression, head, camera and film."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix

from facestage.contract.arrays import Bool, Float
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file, is_folder
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.contract.sequence import HARMONICS_MAX, KEYFRAMES, Sequence

from ..rig.expressions import expression_keys
from ..rig.face_rig import key_name, require_rig, rig_axes
from ..rig.keyframes import Thinning, curves_of, remove_curves, write_curve, write_keys
from ..rig.own_record import OwnMesh
from ..rig.sliders import carrier, value_path
from ..scene import frames
from ..scene.camera import ensure_camera
from ..scene.stage import facestage_collection, light_power, require_stage, stage_lights
from ..skin.haemoglobin import give_haemoglobin, take_haemoglobin, weight_path
from ..skin.wrinkles import DrivenWrinkles, give_wrinkles
from .result_textures import wrinkle_images
from .write_back import apply_result

PLACES = PLACE, TURN, SCALE = "location", "rotation_euler", "scale"
# What is as much as a slider's whole way.
HEAD = {PLACE: 0.1, TURN: math.radians(10.0), SCALE: 0.1}


@dataclass(frozen=True, eq=False)
class Simplicity:
    """How far curves may be from the film where that saves keys.

    Sliders by ``weight``; the head's turn about each axis by 10 degrees, its place along each by
    100 mm for a ``weight`` of 1; a light's power by that share of its most, haemoglobin by that
    share of a standard deviation. Frames that are ``pinned`` keep their keys.
    """

    weight: float = 0.0
    pinned: Bool[np.ndarray, " frames"] | None = None

    def of(self, chosen: slice) -> Simplicity:
        """For some of the frames."""
        return self if self.pinned is None else replace(self, pinned=self.pinned[chosen])

    def thinning(self, scale: float = 1.0) -> Thinning:
        """Of a curve whose values are by ``scale`` what a slider's are by 1."""
        return Thinning(self.weight * scale, self.pinned)


EVERY_KEY = Simplicity()


def apply_performance(scene: bpy.types.Scene, sequence: Sequence, simplify: float = 0.0) -> int:
    """Put a film's person into the scene and key the whole performance from the present frame on.

    Person, camera and, unless it changes, light are those of the first keyframe; scene and film run
    at the film's rate.
    ``simplify``: how far the curves may be from the film where that saves keys, see
    :class:`Simplicity`. The last frame is returned. Raises InputError before anything changes when
    the rig is of another model.
    """
    rig = require_rig(scene)
    if rig.facestage_face.model != sequence.model or OwnMesh.of(rig) is not None:
        raise InputError(
            f"The film was tracked with the face model '{sequence.model}', the rig is of "
            f"'{rig.facestage_face.model}'; build the rig of the film's model first."
        )
    sliders = {key.name for keys in expression_keys(rig).values() for key in keys}
    weights = {key_name(name): column for name, column in _columns(sequence)}
    lacking = sorted(weights.keys() - sliders)
    if lacking:
        raise InputError(
            f"The face rig has no slider '{lacking[0]}', which the film moves; build it again."
        )
    result = keyframe_of(sequence)
    radiance = sequence.light_radiance
    if radiance is not None and radiance.shape[1] != len(result.stage):
        raise InputError(
            f"The film's light is of {radiance.shape[1]} lights, its first keyframe's of "
            f"{len(result.stage)}; track the film again."
        )
    harmonics = sequence.haemoglobin_harmonics
    if harmonics is not None and harmonics.shape[1] != len(rig.data.vertices):
        raise InputError(
            f"The film's haemoglobin is of {harmonics.shape[1]} vertices, the rig has "
            f"{len(rig.data.vertices)}; track the film again."
        )
    images = wrinkle_images(sequence)
    apply_result(scene, result)
    _drive_wrinkles(rig, sequence, images)
    _set_rate(scene, sequence.frame_rate)
    first = scene.frame_current
    times = frame_times(sequence, first)
    simplicity = Simplicity(simplify)
    key_frames(scene, rig, sequence, times, simplicity=simplicity)
    if radiance is not None:
        _key_lights(scene, times, radiance, result.stage.side, simplicity)
    _key_haemoglobin(rig, times, sequence, simplicity)
    _show_film(scene, sequence, first)
    last = int(np.ceil(times[-1] - 1e-3))
    scene.frame_start, scene.frame_end = min(scene.frame_start, first), max(scene.frame_end, last)
    remember(scene, sequence, first)
    scene.facestage.performance_simplify = simplify
    scene.frame_set(first)
    return last


def frame_times(sequence: Sequence, first: float) -> Float[np.ndarray, " frames"]:
    """Where each of the film's frames lies in the scene if it begins at frame ``first``."""
    return first + np.array([each.time for each in sequence.frames]) * sequence.frame_rate


def remember(scene: bpy.types.Scene, sequence: Sequence, first: float) -> None:
    """Note what the keys are of."""
    settings = scene.facestage
    settings.performance, settings.performance_start = str(sequence.folder), first
    settings.performance_mark = mark_of(sequence)


def mark_of(sequence: Sequence) -> str:
    """Another one for other expressions or poses."""
    parts = sequence.expression, sequence.model_to_camera
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def key_frames(
    scene: bpy.types.Scene,
    rig: bpy.types.Object,
    sequence: Sequence,
    times: Float[np.ndarray, " frames"],
    of: slice = slice(None),
    simplicity: Simplicity = EVERY_KEY,
) -> None:
    """Key expression and head of those ``of`` the frames, which lie at ``times`` in the scene."""
    simplicity = simplicity.of(of)
    weights = {key_name(name): column[of] for name, column in _columns(sequence)}
    write_keys(rig, times[of], weights, simplicity.thinning())
    head = {path: each[of] for path, each in head_keys(scene, rig, sequence)}
    _key_head(rig, times[of], head, simplicity)


def _columns(sequence: Sequence) -> list[tuple[str, np.ndarray]]:
    return list(zip(sequence.expression_names, sequence.expression.T, strict=True))


def keyframe_of(sequence: Sequence) -> Result:
    """The first keyframe's result. Raises InputError where it is gone."""
    folder = Path(sequence.folder or "") / KEYFRAMES
    return Result.load(folder / Person.load(folder).photos[0].folder)


def _set_rate(scene: bpy.types.Scene, rate: float) -> None:
    scene.render.fps = max(1, round(rate))
    scene.render.fps_base = scene.render.fps / rate


def head_frame(scene: bpy.types.Scene, face: bpy.types.Object) -> Matrix:
    """From the stage's empty to what the keys of the face's place and turn are relative to."""
    rig = carrier(face)
    parent = Matrix() if rig.parent is None else rig.parent.matrix_world @ rig.matrix_parent_inverse
    return parent.inverted() @ require_stage(scene).matrix_world


def head_keys(
    scene: bpy.types.Scene, face: bpy.types.Object, sequence: Sequence
) -> list[tuple[str, Float[np.ndarray, "frames 3"]]]:
    """Where the face is in every frame, whatever it hangs on: by path of its carrier, x, y, z."""
    rig, axes, base = carrier(face), rig_axes(face), head_frame(scene, face)
    poses = []
    turned = _first_turn(rig)
    for each in keyframe_of(sequence).camera_to_stage @ sequence.model_to_camera:
        place, turn, scale = (base @ Matrix(frames.local_matrix(each, axes).tolist())).decompose()
        turned = turn.to_euler("XYZ", turned)  # next to the last one, not a whole turn away
        poses.append((place, turned, scale))
    columns = zip(*poses, strict=True)
    return [
        (path, np.array([list(each) for each in values]))
        for path, values in zip(PLACES, columns, strict=True)
    ]


def _first_turn(rig: bpy.types.Object) -> Euler:
    """As it is, or as its first keys have it."""
    turn = rig.rotation_euler.copy()
    for curve in curves_of(rig):
        if curve.data_path == "rotation_euler" and len(curve.keyframe_points):
            turn[curve.array_index] = curve.keyframe_points[0].co.y
    return turn


def _key_head(
    face: bpy.types.Object,
    times: Float[np.ndarray, " frames"],
    keys: Mapping[str, Float[np.ndarray, "frames 3"]],
    simplicity: Simplicity,
) -> None:
    """Key where the face is."""
    rig = carrier(face)
    rig.rotation_mode = "XYZ"
    for path, values in keys.items():
        setattr(rig, path, values[0])
        rig.keyframe_insert(path, frame=float(times[0]))  # makes action, slot and curves
        for axis, column in enumerate(values.T):
            write_curve(rig, path, axis, times, column, simplicity.thinning(HEAD[path]))


def _key_lights(
    scene: bpy.types.Scene,
    times: Float[np.ndarray, " frames"],
    radiance: Float[np.ndarray, "frames lights 3"],
    sides: Float[np.ndarray, " lights"],
    simplicity: Simplicity,
) -> None:
    """Key the power and the color of every light."""
    for index, light in enumerate(stage_lights(require_stage(scene))):
        energy, color = light_power(radiance[:, index], float(sides[index]))
        light.data.energy, light.data.color = float(energy[0]), color[0]
        for path in ("energy", "color"):
            light.data.keyframe_insert(path, frame=float(times[0]))  # makes action, slot and curves
        brightest = float(energy.max())
        write_curve(light.data, "energy", 0, times, energy, simplicity.thinning(brightest))
        for channel, column in enumerate(color.T):
            write_curve(light.data, "color", channel, times, column, simplicity.thinning())


def _key_haemoglobin(
    rig: bpy.types.Object,
    times: Float[np.ndarray, " frames"],
    sequence: Sequence,
    simplicity: Simplicity,
) -> None:
    """Key how much more or less of it the skin has, if the film says so."""
    weights, harmonics = sequence.haemoglobin, sequence.haemoglobin_harmonics
    if weights is None or harmonics is None or sequence.haemoglobin_color is None:
        paths = {weight_path(harmonic)[0] for harmonic in range(HARMONICS_MAX)}
        for tree in take_haemoglobin(rig):
            remove_curves(tree, paths)
        return
    for tree in give_haemoglobin(rig, harmonics, sequence.haemoglobin_color):
        for harmonic, column in enumerate(weights.T):
            path, axis = weight_path(harmonic)
            tree.keyframe_insert(path, index=axis, frame=float(times[0]))  # makes the curve
            write_curve(tree, path, axis, times, column, simplicity.thinning())


def _drive_wrinkles(
    rig: bpy.types.Object, sequence: Sequence, images: Mapping[str, bpy.types.Image]
) -> None:
    """Let wrinkles come with the sliders that bring them, if the film says so."""
    keys = rig.data.shape_keys

    def path(slider: str) -> str:
        return value_path(keys.key_blocks[key_name(slider)])

    give_wrinkles(
        rig,
        [
            DrivenWrinkles(each.name, images[each.name], keys, [path(one) for one in each.sliders])
            for each in sequence.wrinkles
        ],
    )


def _show_film(scene: bpy.types.Scene, sequence: Sequence, first: int) -> None:
    """Show the film behind the camera, if it is still there."""
    film = Path(sequence.film)
    if is_folder(film):
        film /= sequence.frames[0].name
    if not is_file(film):
        return
    try:
        image = bpy.data.images.load(str(film), check_existing=True)
    except RuntimeError:  # a film that this Blender cannot decode
        return
    if image.source == "FILE" and len(sequence.frames) > 1:
        image.source = "SEQUENCE"
    data = ensure_camera(scene, facestage_collection(scene)).data
    data.show_background_images = True
    background = next(iter(data.background_images), None) or data.background_images.new()
    background.image, background.frame_method = image, "FIT"
    background.display_depth = "BACK"
    user = background.image_user
    user.frame_start, user.frame_duration = first, len(sequence.frames)
    user.frame_offset = sequence.frames[0].number - 1
    user.use_auto_refresh = True
