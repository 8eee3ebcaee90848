"""A photo whose truth is known: a person of the face model, rendered by Cycles.

The skin has texture that no albedo coefficient can explain, and the landmarks have noise, as in
life.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.case_files import (
    CAMERA,
    COMPRESSED_PHOTO,
    LANDMARKS,
    LINEAR_PHOTO,
    PHOTO,
    SKIN,
    TRUTH,
)
from facestage.contract.face_model import FaceModel
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.storage import write_arrays, write_json
from facestage.contract.job import DEFAULT_MODEL
from facestage.contract.landmarks import IBUG
from facestage.contract.light_stage import LightStage

from ..pictures.images import texture_image
from ..pictures.render import read_pixels, render_linear, save_exr, save_jpeg, save_png, srgb
from ..rig.face_rig import build_rig, set_weights
from ..scene import frames
from ..scene.camera import ensure_camera, write_camera
from ..scene.stage import build_stage, facestage_collection, place
from ..skin.material import plain_material, set_scattering, set_textures
from .cases import relief
from .scans.light import Surroundings, light_world, shipped
from .sightlines import BACKGROUND as NOTHING
from .sightlines import FACE, HEAD, NARROW_FACE, WORN, Sightlines
from .truth import SIZE, Optics, Person, Worn, landmark_points

LANDMARK_NOISE_PX = 1.0  # in a picture of SIZE pixels
BRIGHTEST = 0.85  # linear value of the photo's brightest skin but for 1 %
BACKGROUND = 0.03
READ_NOISE = 3.0  # electrons


def render_person(
    scene: bpy.types.Scene,
    model: FaceModel,
    person: Person,
    folder: Path,
    samples: int = 128,
    seed: int = 0,
    size: int = SIZE,
) -> None:
    """Photograph a person into ``folder``: photo.png/.exr, landmarks.json, camera.json, truth.npz
    and skin.png.

    skin.png is white where the camera sees bare skin of the head. A compressed photo is there as
    photo.jpg too; then photo.png holds its pixels.
    """
    camera = Camera.default(size, size, person.focal_px * size / SIZE)
    camera_to_stage = np.eye(4)
    camera_to_stage[:3, 3] = -person.model_to_camera[:3, 3]
    _build(scene, model, person, camera, camera_to_stage)

    pixels = render_linear(
        scene,
        samples,
        direct_only=not person.interreflection,
        seed=seed,
        denoise=person.scattering > 0,
    )
    vertices = _moved(model.shape(person.identity, person.expression), person.model_to_camera)
    worn = [(_moved(item.vertices, person.model_to_camera), item.triangles) for item in person.worn]
    sightlines = Sightlines(model, vertices, worn)
    labels = sightlines.picture(camera)
    mask = (pixels[..., 3] > 0.99) & (labels != WORN) & (labels != NOTHING)
    exposure = BRIGHTEST / float(np.percentile(pixels[..., :3][mask], 99))
    stage = person.stage.with_radiance(person.stage.radiance * exposure)
    build_stage(scene, stage)
    picture = exposure * pixels[..., :3] + BACKGROUND * (1 - pixels[..., 3:])
    picture = noisy(picture, person.optics.electrons, np.random.default_rng(seed + 2))

    points = landmark_points(model, vertices)
    spread = LANDMARK_NOISE_PX * size / SIZE
    noise = spread * np.random.default_rng(seed + 1).normal(size=(len(points), 2))
    found = camera.project(points) + noise
    lights = stage.transformed(np.linalg.inv(camera_to_stage))
    truth = {"vertices": vertices.astype(np.float32)} | _truth(person, model)
    if person.sky is None:
        truth |= _light_truth(lights)
    bare = np.isin(labels, (NARROW_FACE, FACE, HEAD))
    with atomic_folder(folder) as unfinished:
        _save_photo(unfinished, picture, person.optics)
        save_png(unfinished / SKIN, bare[..., None] * np.ones(3))
        write_json(unfinished / CAMERA, camera.to_json())
        write_json(
            unfinished / LANDMARKS,
            {"scheme": IBUG, "points": found, "visible": sightlines.visible(points)},
        )
        write_arrays(unfinished / TRUTH, truth | {"labels": labels, "mask": mask})


def noisy(picture: np.ndarray, electrons: float | None, rng: np.random.Generator) -> np.ndarray:
    """``picture`` (h, w, 3) as a sensor counts it that holds ``electrons`` at 1: shot noise, and
    READ_NOISE of reading.

    Values beyond 1 are kept, for the EXR; what is written as a display image clips.
    """
    if electrons is None:
        return picture
    counted = rng.poisson(np.maximum(picture, 0) * electrons) + READ_NOISE * rng.normal(
        size=picture.shape
    )
    return np.maximum(counted / electrons, 0.0).astype(picture.dtype)


def face_tile(texture: np.ndarray, model: FaceModel) -> np.ndarray:
    """The part of an atlas texture (s, s, c) that the model's published UV tile of the face
    covers.
    """
    u, v, scale = model.face_tile
    size = len(texture)
    left, top, side = round(u * size), round((1 - v - scale) * size), round(scale * size)
    return texture[top : top + side, left : left + side]


def _save_photo(folder: Path, picture: np.ndarray, optics: Optics) -> None:
    """Write a linear picture (h, w, 3) as an EXR and as a photo, compressed where a camera does."""
    encoded = srgb(picture)
    if optics.jpeg_quality is not None:
        save_jpeg(folder / COMPRESSED_PHOTO, encoded, optics.jpeg_quality)
        encoded = read_pixels(folder / COMPRESSED_PHOTO)[..., :3]
    save_png(folder / PHOTO, encoded)
    save_exr(folder / LINEAR_PHOTO, picture)


def _light_truth(lights: LightStage) -> dict[str, np.ndarray]:
    """What is true of the lights (camera frame), as truth.npz names it."""
    return {
        "light_position": lights.position,
        "light_direction": lights.direction,
        "light_corners": lights.corners,
        "light_radiance": lights.radiance,
    }


def _truth(person: Person, model: FaceModel) -> dict[str, np.ndarray]:
    """What is true of the person, as truth.npz names it."""
    truth = {
        "identity": person.identity,
        "expression": person.expression,
        "albedo": face_tile(person.albedo, model).astype(np.float32),
        "specular": person.specular,
        "roughness": np.array(person.roughness),
        "model_to_camera": person.model_to_camera,
    }
    if person.height is not None:
        truth["height_mm"] = face_tile(person.height, model).astype(np.float32)
    return truth


def _build(
    scene: bpy.types.Scene,
    model: FaceModel,
    person: Person,
    camera: Camera,
    camera_to_stage: np.ndarray,
) -> None:
    """Make the scene show the person to the camera."""
    empty = build_stage(scene, person.stage)
    rig = build_rig(scene, model, DEFAULT_MODEL, empty)
    set_weights(
        rig,
        dict(zip(model.identity_names, person.identity, strict=True)),
        dict(zip(model.expression_names, person.expression, strict=True)),
    )
    images = {
        name: texture_image(f"True {name.capitalize()}", getattr(person, name))
        for name in ("albedo", "specular")
    }
    set_textures(rig, images, {"roughness": person.roughness})
    set_scattering(rig, person.scattering)
    view = ensure_camera(scene, facestage_collection(scene))
    write_camera(scene, view.data, camera)
    pose = camera_to_stage @ person.model_to_camera
    place(empty, rig, pose, frames.STAGE)
    place(empty, view, camera_to_stage, frames.CAMERA)
    if person.height is not None:
        _displace(scene, rig, model, person)
    if person.optics.f_number is not None:
        view.data.dof.use_dof, view.data.dof.aperture_fstop = True, person.optics.f_number
        view.data.dof.focus_distance = float(_eyes_distance(model, person))
    else:
        view.data.dof.use_dof = False
    for item in person.worn:
        _add(scene, empty, item, pose)
    for item in person.around:
        _add(scene, empty, item, np.eye(4))
    if person.sky is not None:
        sky = Surroundings(person.sky.name, shipped()[person.sky.name], person.sky.turn)
        light_world(scene, sky, vertical="Z")


def _displace(
    scene: bpy.types.Scene, rig: bpy.types.Object, model: FaceModel, person: Person
) -> None:
    """Show a finely divided head with the person's relief in the place of the rig."""
    assert person.height is not None
    shape = model.shape(person.identity, person.expression)
    points, normals, uvs, triangles, part = relief.displaced(model, shape, person.height)
    mesh = bpy.data.meshes.new("Displaced")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", frames.points_to_blender(points).astype(np.float32).ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.astype(np.int32).ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", 3 * np.arange(len(triangles), dtype=np.int32))
    uv = mesh.uv_layers.new(name="UVMap", do_init=False)
    mesh.polygons.foreach_set(
        "material_index", np.searchsorted(np.unique(model.polygon_part), part).astype(np.int32)
    )
    mesh.update(calc_edges=True)
    uv.uv.foreach_set("vector", uvs[triangles].astype(np.float32).ravel())
    mesh.shade_smooth()
    mesh.normals_split_custom_set_from_vertices(frames.points_to_blender(normals).tolist())
    for material in rig.data.materials:
        mesh.materials.append(material)
    head = bpy.data.objects.new("Displaced", mesh)
    facestage_collection(scene).objects.link(head)
    head.parent, head.matrix_parent_inverse = rig.parent, Matrix()
    head.matrix_basis = rig.matrix_basis
    rig.hide_render = True


def _add(scene: bpy.types.Scene, empty: bpy.types.Object, item: Worn, pose: np.ndarray) -> None:
    """Put a thing into the stage; ``pose`` (4, 4) brings its points into the stage frame."""
    mesh = bpy.data.meshes.new(item.name)
    mesh.from_pydata(frames.points_to_blender(item.vertices).tolist(), [], item.triangles.tolist())
    mesh.shade_smooth()
    mesh.materials.append(plain_material(item.name, item.color, item.roughness))
    thing = bpy.data.objects.new(item.name, mesh)
    facestage_collection(scene).objects.link(thing)
    thing.parent, thing.matrix_parent_inverse = empty, Matrix()
    place(empty, thing, pose, frames.STAGE)


def _eyes_distance(model: FaceModel, person: Person) -> float:
    """How far the eyes are from the camera along its axis, in m: what a photographer focuses on."""
    eyes = np.concatenate([model.regions["eye_left"], model.regions["eye_right"]])
    shape = model.shape(person.identity, person.expression)[eyes]
    return float(-_moved(shape, person.model_to_camera)[:, 2].max())


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]
