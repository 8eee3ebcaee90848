"""The whole way without a window: build -> job -> backend -> result -> write-back -> save.

For batch and demo.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from facestage.contract.camera import Camera
from facestage.contract.errors import (
    BackendUnavailableError,
    CancelledError,
    FacestageError,
    InputError,
)
from facestage.contract.events import DONE, Event
from facestage.contract.face_model import FaceModel
from facestage.contract.job import DEFAULT_MODEL, DEVICES, LIGHT_COLORS
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import DEFAULT_COUNT
from facestage.contract.quality import GOOD
from facestage.contract.result import Result
from facestage.contract.sequence import Sequence

from ..backend.commands import fit_command, model_command
from ..backend.process import BackendProcess
from ..exchange.performance import apply_performance
from ..exchange.photos import add_photos, show, take_results
from ..exchange.scene_read import read_jobs
from ..exchange.write_back import apply_result
from ..pictures.images import load_image
from ..pictures.render import quiet
from ..preferences import online_access
from ..properties import BY_ANGLE
from ..rig.face_rig import build_rig
from ..rig.own_rig import adopt, export_mesh
from ..scene.camera import ensure_camera, require_camera, show_photo, write_camera
from ..scene.paths import RESULT_FOLDER, job_folders, result_folder
from ..scene.stage import build_stage, default_stage, facestage_collection
from ..scene.user_state import preserved
from .additions import add_to_face

SCENE_FILE = "scene.blend"


@dataclass(frozen=True)
class Photo:
    """A photo, and what is known of it."""

    image: Path
    landmarks: Path | None = None
    camera: Path | None = None
    truth: Path | None = None


@dataclass(frozen=True)
class Order:
    """What to fit, and where to put it."""

    image: Path
    out: Path
    landmarks: Path | None = None
    camera: Path | None = None
    focal_px: float | None = None
    model: str = DEFAULT_MODEL
    lights: int = DEFAULT_COUNT
    light_color: str = LIGHT_COLORS[0]
    skin_tone: float | None = None  # its typology angle in degrees
    freeze: tuple[str, ...] = ()
    budget: float | None = None
    quality: str = GOOD
    seed: int = 0
    device: str = DEVICES[0]
    truth: Path | None = None
    resume: bool = False
    face: int = 1  # which face of a photo without landmarks; 1 is the largest
    rig_blend: Path | None = None  # a .blend with a mesh of the user's, which then is the rig
    rig_object: str = ""
    more: tuple[Photo, ...] = ()  # of the same person
    add: tuple[str, ...] = ()  # of ADDITIONS

    @property
    def photos(self) -> tuple[Photo, ...]:
        """All photos."""
        return (Photo(self.image, self.landmarks, self.camera, self.truth), *self.more)


def empty_scene() -> bpy.types.Scene:
    """Start from an empty scene with the add-on registered."""
    _register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def open_scene(path: Path) -> bpy.types.Scene:
    """Start from a .blend of the user's with the add-on registered; its scripts are not run."""
    _register()
    if not path.is_file():
        raise InputError(f"The scene '{path}' does not exist; check the path.")
    try:
        with quiet():
            bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise InputError(
            f"The scene '{path}' cannot be opened; give a .blend that this Blender can read."
        ) from error
    return bpy.context.scene


def _register() -> None:
    from .. import registration

    if not hasattr(bpy.types.Scene, "facestage"):
        registration.register()


def fit_photo(
    scene: bpy.types.Scene, order: Order, backend: list[str], on_event: Callable[[Event], None]
) -> Result:
    """Build stage and rig, fit them to the photo, or to all photos of the person, write the first
    one's result back and save the .blend.

    Returns that result. Raises FacestageError with the backend's own sentence when it fails; then
    no .blend is written.
    """
    prepare_scene(scene, order, backend, on_event)
    photos = order.photos
    jobs, folders = read_jobs(scene), job_folders(order.out, len(photos))
    for job, photo, path in zip(jobs, photos, folders, strict=True):
        truth = None if photo.truth is None else photo.truth.resolve()
        replace(job, truth=truth).save(path)
    folder = order.out / RESULT_FOLDER
    run_backend(fit_command(backend, folders, folder, order.resume), on_event)
    take_results(scene, folder, [photo.image.resolve() for photo in photos])
    result = Result.load(result_folder(scene))
    apply_result(scene, result)
    save_blend(order.out / SCENE_FILE)  # before something is asked of the rig that it can not have
    if order.add:
        add_to_face(scene, order.add)
        save_blend(order.out / SCENE_FILE)
    return result


def animate(
    scene: bpy.types.Scene,
    sequence: Sequence,
    out: Path,
    simplify: float,
    backend: list[str],
    on_event: Callable[[Event], None],
    add: tuple[str, ...] = (),
) -> None:
    """Build the film's person, key the performance from frame 1 on, and save the .blend.

    Raises FacestageError with the backend's own sentence when it fails; then no .blend is written.
    """
    model = face_model(sequence.model, backend, on_event)
    settings = scene.facestage
    settings.model, settings.output = sequence.model, str(out)
    stage = default_stage(settings.light_count, settings.light_radius, settings.light_side)
    build_rig(scene, model, sequence.model, build_stage(scene, stage))
    scene.frame_end = apply_performance(scene, sequence, simplify)
    if add:
        add_to_face(scene, add)
    save_blend(out / SCENE_FILE)


def prepare_scene(
    scene: bpy.types.Scene, order: Order, backend: list[str], on_event: Callable[[Event], None]
) -> None:
    """Check the order's files, then build the light stage and the rig, and set the scene's job."""
    cameras = [_checked(photo, order.focal_px) for photo in order.photos]
    settings = scene.facestage
    stage = default_stage(order.lights, settings.light_radius, settings.light_side)
    try:
        order.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"Cannot write the folder '{order.out}': {error.strerror or error}; choose one "
            "that you may write to."
        ) from error
    if order.rig_blend is not None:
        use_mesh(scene, order.rig_object, order.out, backend, on_event)
    else:
        model = face_model(order.model, backend, on_event)
    settings.photo, settings.landmarks = str(order.image), str(order.landmarks or "")
    settings.face_number = order.face
    settings.light_count, settings.light_color = order.lights, order.light_color
    if order.skin_tone is not None:
        settings.skin_tone, settings.skin_angle = BY_ANGLE, order.skin_tone
    settings.freeze, settings.budget, settings.seed = (
        set(order.freeze),
        order.budget or 0.0,
        order.seed,
    )
    settings.device, settings.output, settings.quality = order.device, str(order.out), order.quality
    empty = build_stage(scene, stage)
    if order.rig_blend is None:
        settings.model = order.model
        build_rig(scene, model, order.model, empty)
    show_photo(scene, ensure_camera(scene, facestage_collection(scene)), order.image)
    _know_lens(scene, cameras[0])
    if order.more:
        add_photos(scene, [photo.image for photo in order.more])
        for number, (photo, camera) in enumerate(zip(order.more, cameras[1:], strict=True), 2):
            show(scene, number)
            settings.landmarks = str(photo.landmarks or "")
            _know_lens(scene, camera)
        show(scene, 1)


def _know_lens(scene: bpy.types.Scene, camera: Camera | None) -> None:
    """Give the photo that is shown its lens, where it is known."""
    scene.facestage.known_lens = camera is not None
    if camera is not None:
        write_camera(scene, require_camera(scene).data, camera)


def use_mesh(
    scene: bpy.types.Scene,
    name: str,
    folder: Path,
    backend: list[str],
    on_event: Callable[[Event], None],
) -> None:
    """Make the scene's mesh of this name the face rig; without a name, the only mesh that has shape
    keys.
    """
    keyed = [
        item for item in scene.objects if item.type == "MESH" and item.data.shape_keys is not None
    ]
    item = scene.objects.get(name) if name else keyed[0] if len(keyed) == 1 else None
    if item is None:
        meshes = (
            ", ".join(sorted(other.name for other in scene.objects if other.type == "MESH"))
            or "none"
        )
        raise InputError(
            f"The scene has no object '{name}'; its meshes: {meshes}."
            if name
            else f"{len(keyed)} meshes of the scene have shape keys; name one with "
            f"--rig-object (meshes: {meshes})."
        )
    for layer in scene.view_layers:
        layer.update()
    with preserved(bpy.context.view_layer):
        path, rig, own, notes = export_mesh(item, folder)
    for note in notes:
        print(f"facestage: {note}", file=sys.stderr)
    spec = f"rig:{path}"
    adopt(scene, item, spec, face_model(spec, backend, on_event), rig, own)


def face_model(spec: str, backend: list[str], on_event: Callable[[Event], None]) -> FaceModel:
    """The face model that ``spec`` names, exported by the backend."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.npz"
        run_backend(model_command(backend, spec, file), on_event)
        return FaceModel.load(file)


def run_backend(command: list[str], on_event: Callable[[Event], None]) -> None:
    """Run the backend to its end. Raises the typed error that its exit code stands for."""
    child = BackendProcess(command, online_access())
    try:
        outcome = child.wait(on_event)
    except BaseException:
        child.cancel()
        raise
    if outcome.ok:
        return
    kinds: dict[int, type[FacestageError]] = {
        kind.exit_code: kind for kind in (InputError, CancelledError)
    }
    kind = kinds.get(outcome.code, BackendUnavailableError)
    raise kind(outcome.message)


def save_blend(path: Path) -> None:
    """Save the scene as a .blend that carries its textures and the photo."""
    for image in bpy.data.images:
        if image.source == "FILE" and not image.packed_file and image.size[0]:
            image.pack()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with quiet():
            bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, check_existing=False)
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"Cannot write '{path}'; choose an output folder that you may write to."
        ) from error


def progress_printer() -> Callable[[Event], None]:
    """A function that shows events on stderr: one changing line on a terminal, a line for each
    stage elsewhere.
    """
    terminal = sys.stderr.isatty()
    last = ""

    def show(event: Event) -> None:
        nonlocal last
        text = f"{event.fraction:4.0%}  {event.stage or event.kind}"
        if event.error is not None:
            text += f"  photo error {event.error:.4f}"
        if event.seconds_left is not None:
            text += f"  about {event.seconds_left:.0f} s left"
        if terminal:
            print(
                f"\r{text:<78}", end="\n" if event.kind == DONE else "", file=sys.stderr, flush=True
            )
        elif event.stage != last:
            print(text, file=sys.stderr, flush=True)
        last = event.stage

    return show


def _checked(photo: Photo, focal_px: float | None) -> Camera | None:
    """The photo's camera where it is known. Raises InputError for a file that is not right."""
    width, height = load_image(photo.image).size
    if photo.landmarks is not None:
        Landmarks.read(photo.landmarks).check_inside(width, height)
    if photo.truth is not None and not photo.truth.is_file():
        raise InputError(f"The truth file '{photo.truth}' does not exist; check the path.")
    if photo.camera is None:
        return None if focal_px is None else Camera.default(width, height, focal_px)
    camera = Camera.read(photo.camera)
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"The camera file '{photo.camera}' is for {camera.width} x {camera.height} pixels, "
            f"the photo has {width} x {height}; give the camera of this photo."
        )
    return camera
