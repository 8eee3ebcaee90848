"""What is done with each input: one function per reader, which reads, looks at what came out, and uses it a little."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from fuzz.consistent import check, check_array, check_dataclass, require


class Refused(Exception):
    """The command line refused its arguments with a sentence."""


def install_small_default_model() -> None:
    """Let ``default`` be a face of 168 vertices, so that what is carried over from it costs milliseconds."""
    from facestage.models import registry
    from fuzz.seeds_contract import small_default

    real = registry.load_model

    def load_model(specification: str) -> Any:
        return small_default() if specification == "default" else real(specification)

    registry.load_model = load_model


def read_job(folder: Path) -> None:
    from facestage.contract.job import Job

    job = Job.load(folder)
    points = None if job.landmarks is None else job.landmarks
    check_dataclass(job, but=("landmarks",))
    if points is not None:
        check_landmarks(points)


def check_landmarks(landmarks: Any) -> None:
    check_dataclass(landmarks, but=("points",))
    check_array(landmarks.points[landmarks.counted], "Landmarks.points")
    require(landmarks.visible.dtype == bool, "Landmarks.visible is not bool")


def read_result(folder: Path) -> None:
    check_result(load_result(folder))


def load_result(folder: Path) -> Any:
    from facestage.contract.result import Result

    return Result.load(folder)


def check_result(result: Any) -> None:
    check_dataclass(result)
    count = len(result.vertices)
    require(result.vertices.shape == (count, 3), "Result.vertices is not (n, 3)")
    require(result.triangles.ndim == 2 and result.triangles.shape[1] == 3, "Result.triangles is not (t, 3)")
    inside = not result.triangles.size or (result.triangles.min() >= 0 and result.triangles.max() < count)
    require(inside, "Result.triangles refers to vertices that are not there")
    require(result.identity.shape == (len(result.identity_names),), "Result.identity and its names differ")
    require(result.expression.shape == (len(result.expression_names),), "Result.expression and its names differ")
    for name in ("camera_to_stage", "model_to_camera", "model_to_stage"):
        require(getattr(result, name).shape == (4, 4), f"Result.{name} is not (4, 4)")
    require(result.specular.ndim == 2 and result.albedo.ndim == 1, "Result's coefficients have other dimensions")
    require(np.isfinite(result.model_to_stage).all(), "Result.model_to_stage is not finite")


def read_person(folder: Path) -> None:
    from facestage.contract.person import Person

    person = Person.load(folder)
    check_dataclass(person)
    require(person.identity.ndim == person.albedo.ndim == 1 and person.specular.ndim == 2, "Person has other shapes")


def read_landmarks(folder: Path) -> None:
    from facestage.contract.landmarks import Landmarks

    found = Landmarks.read(folder / "landmarks.json")
    check_landmarks(found)
    found.check_inside(24, 20)


def read_camera(folder: Path) -> None:
    from facestage.contract.camera import Camera

    found = Camera.read(folder / "camera.json")
    check_dataclass(found)
    check_dataclass(found.scaled(0.5))


def read_event(folder: Path) -> None:
    from facestage.contract.events import Event

    line = (folder / "line.json").read_bytes().decode("utf-8", "replace")
    event = Event.from_line(line)
    if event is not None:
        check_dataclass(event)
        event.to_line()


@cache
def _truth_scene() -> tuple[Any, Any]:
    from facestage.contract.camera import Camera
    from facestage.fit.geometry import FaceGeometry
    from facestage.fit.parameters import State
    from fuzz.seeds_contract import tiny_model

    model = tiny_model()
    state = State(
        np.eye(3), np.array([0, 0, -0.6]), Camera.default(24, 20), np.zeros(len(model.identity_names)),
        np.zeros(len(model.expression_names)), np.zeros(0), np.zeros((0, 2)), np.zeros(len(model.albedo_basis)), 0.4,
        np.full((2, 2), 0.5),
    )  # fmt: skip
    return FaceGeometry(model), state


def read_truth(folder: Path) -> None:
    from facestage.contract.light_stage import fibonacci_stage
    from facestage.fit.truth import Truth

    geometry, state = _truth_scene()
    truth = Truth(folder / "truth.npz", geometry)
    check(truth.geometry_errors(state), dict[str, float], "geometry errors")
    check(truth.light_error(fibonacci_stage(2), np.zeros(3)), float | None, "light error")
    check(truth.albedo_error(np.full((4, 4, 3), 0.4)), float | None, "albedo error")


def read_relight(folder: Path) -> None:
    from facestage.contract.relight_cache import RelightCache

    result = load_result(folder)
    cache_ = RelightCache.load(result)
    check_dataclass(cache_)
    picture = cache_.relight(np.ones((len(result.stage), 3)))
    require(np.isfinite(picture).all(), "a relit picture is not finite")


def read_render(folder: Path) -> None:
    """``facestage render`` with light and weight files, up to the renderer."""
    from facestage.fit import relight
    from facestage.image_io import read_exr

    def stand_in(result: Any, *_samples: Any, **_options: Any) -> np.ndarray:
        check_result(result)
        relight.load_model(result.model)
        for name in ("albedo.exr", "specular.exr", "roughness.exr"):
            if (result.folder / name).is_file():
                check_array(read_exr(result.folder / name), name)
        return np.zeros((result.camera.height, result.camera.width, 3), np.float32)

    lights = _json_or_none(folder / "lights.json", "light file")
    weights = _json_or_none(folder / "weights.json", "weight file")
    with mock.patch.object(relight, "render", stand_in), mock.patch.object(relight, "relit", stand_in):
        relight.render_result(folder, folder / "out.png", lights, weights, None)


def _json_or_none(path: Path, what: str) -> dict[str, Any] | None:
    from facestage.contract.storage import read_json

    return read_json(path, what) if path.exists() else None


def read_memory(folder: Path) -> None:
    from facestage import native

    with mock.patch.dict(os.environ, FACESTAGE_CACHE=str(folder)):
        check(native._remembered(), list[str], "what native.json remembers")


def read_checkpoint(folder: Path) -> None:
    from facestage.fit.checkpoint import Checkpoint

    found = Checkpoint.load(folder)
    if found is not None:
        check_dataclass(found, but=("camera_to_stage",))


def read_joint_checkpoint(folder: Path) -> None:
    from facestage.fit.joint_checkpoint import JointCheckpoint

    found = JointCheckpoint.load(folder)
    if found is not None:
        check_dataclass(found, but=("photos",))
        for photo in found.photos:
            check_dataclass(photo, but=("camera_to_stage",))


def read_rig_file(folder: Path) -> None:
    from facestage.contract.rig_file import RigFile

    rig = RigFile.load(folder / "rig.npz")
    check_dataclass(rig)
    check({str(index): place for index, place in rig.known_points().items()}, dict[str, np.ndarray], "known points")


def read_rig(folder: Path) -> None:
    from facestage.models.rig import load_rig

    check_model(load_rig(folder / "rig.npz"))


def read_face_model(folder: Path) -> None:
    from facestage.models.registry import load_model

    check_model(load_model(f"npz:{folder / 'face.npz'}"))


def check_model(model: Any) -> None:
    check_dataclass(model)
    require(len(model.expression_box) == len(model.expression_names), "expression_box and its names differ")
    require(len(model.triangles) == len(model.triangle_uvs) == len(model.triangle_part), "triangles differ in number")
    for scheme in model.landmarks:
        vertices, weights = model.landmark_vertices(scheme)
        check_array(np.einsum("mk,mkc->mc", weights, model.vertices[vertices]), f"landmarks {scheme}")
    check_array(model.shape(np.ones(len(model.identity_names)), np.ones(len(model.expression_names))), "a shape")
    check_array(model.albedo(np.zeros(len(model.albedo_basis))), "an albedo")


def read_pickled(folder: Path) -> None:
    from facestage.models.restricted_pickle import read_pickle

    read_pickle(folder / "a.pkl", "pickle")


def read_flame(folder: Path) -> None:
    from facestage.models.flame import load_flame

    check_model(load_flame(folder))


def read_bfm(folder: Path) -> None:
    from facestage.models.bfm import load_bfm

    check_model(load_bfm(folder))


def read_gnm(folder: Path) -> None:
    from facestage.models.gnm import load_gnm

    check_model(load_gnm(folder))


def read_ict(folder: Path) -> None:
    from facestage.models.ict import load_ict

    files = [path for path in folder.iterdir() if path.name.startswith("ict")]
    check_model(load_ict(files[0] if files else folder / "ict"))


def read_bomb(folder: Path) -> None:
    """A file that is larger than it seems, by the reader that its name tells."""
    from facestage.models.bfm import load_bfm

    for path in sorted(folder.iterdir()):
        if path.name.startswith("ict"):
            read_ict(folder)
        elif path.suffix == ".h5":
            load_bfm(path)
        else:
            {".npz": read_any_arrays, ".pkl": read_pickled, ".png": read_photo}[path.suffix](folder)


def read_bundle(folder: Path) -> None:
    from facestage.landmarks.model_file import open_model

    open_model(folder / "face_landmarker.task")


def read_geometry(folder: Path) -> None:
    from facestage.landmarks.canonical import read_canonical

    face = read_canonical((folder / "geometry.binarypb").read_bytes())
    check_array(face.vertices, "the canonical face's vertices")
    require(face.triangles.min() >= 0, "a corner of the canonical face is negative")
    check_array(face.mirror, "mirror")
    check_array(face.edges, "edges")


def read_photo(folder: Path) -> None:
    from facestage.image_io import read_photograph

    files = sorted(folder.iterdir())
    photo = read_photograph(files[0] if files else folder / "a.png")
    check_dataclass(photo)
    size = photo.size[::-1]
    require(
        photo.color.shape == photo.clipped.shape == (*size, 3) and photo.mask.shape == size, "a photo's shapes differ"
    )
    require(photo.color.dtype == np.float32 and photo.color.min() >= 0, "a photo's colors are negative")
    require(photo.focal is None or photo.focal.focal_px > 0, "a photo's lens has no length")


def read_profile(folder: Path) -> None:
    from PIL import Image

    from facestage.color_profile import decoder_of, through_littlecms
    from fuzz.seeds_images import picture

    data = (folder / "a.icc").read_bytes()
    decoder = decoder_of(data)
    for kind in (np.uint8, np.uint16):
        if decoder is not None:
            color = decoder(picture(3, kind))
            require(np.isfinite(color).all() and color.min() >= 0, "a profile decodes to no color")
            require(decoder.name.isprintable(), "a profile's name is not printable")
    if decoder is None:
        through_littlecms(Image.fromarray(picture(3)), data)


def read_exif(folder: Path) -> None:
    from PIL import Image

    from facestage.exif import focal_prior

    exif = Image.Exif()
    # What Pillow itself refuses, reading the photo refuses.
    with contextlib.suppress(SyntaxError, ValueError, OSError, KeyError, TypeError):
        exif.load((folder / "a.exif").read_bytes())
        exif.get_ifd(0x8769)
    found = focal_prior(exif, 24, 18)
    if found is not None:
        check_dataclass(found)
        require(found.focal_px > 0 and found.log_sigma > 0, "a lens of no length")


def read_any_json(folder: Path) -> None:
    from facestage.contract.storage import finite, read_json

    data = read_json(folder / "a.json", "file")
    json.dumps(finite(data), allow_nan=False)


def read_any_arrays(folder: Path) -> None:
    from facestage.contract.storage import read_arrays

    for name, array in read_arrays(folder / "a.npz", "file").items():
        require(isinstance(name, str) and isinstance(array, np.ndarray), "an array is none")
        require(not array.dtype.hasobject, "an array holds objects")


def run_command(folder: Path) -> None:
    """A command line in the input's folder; what would compute for minutes does nothing."""
    from facestage import cli

    arguments = [str(item).replace("\0", "") for item in json.loads((folder / "arguments.argv").read_bytes())]
    error, output = io.StringIO(), io.StringIO()
    before = Path.cwd()
    os.chdir(folder)
    try:
        with _stand_ins(), contextlib.redirect_stderr(error), contextlib.redirect_stdout(output):
            try:
                code: object = cli.main(arguments)
            # argparse prints how a command is used and leaves.
            except SystemExit as leaving:
                code = leaving.code
                require(code in (0, 2), f"the exit code is {code}")
                return
    finally:
        os.chdir(before)
    require(code in (0, 2), f"the exit code is {code}")
    if code:
        sentence = error.getvalue()
        require(sentence.startswith("facestage: ") and sentence.endswith("\n"), f"no sentence: {sentence!r:.200}")
        raise Refused(sentence[:-1])


@contextlib.contextmanager
def _stand_ins() -> Iterator[None]:
    def nothing(*_arguments: Any, **_options: Any) -> int:
        return 0

    names = {
        "facestage.fit.run": ("fit_job",),
        "facestage.fit.person": ("fit_person",),
        "facestage.fit.relight": ("make_cache", "render_result"),
        "facestage.bench.run": ("run_bench",),
        "facestage.bench.plan_savings": ("run_plan_savings",),
        "facestage.stress.run": ("list_cases", "run_stress"),
        "facestage.doctor": ("run_doctor",),
    }
    modules = {name: types.ModuleType(name) for name in names}
    for name, functions in names.items():
        for function in functions:
            setattr(modules[name], function, nothing)
    with mock.patch.dict(sys.modules, modules):
        yield
