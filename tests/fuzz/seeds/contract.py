"""Valid inputs for the contract's readers and for what the backend keeps, written by the project's
own writers.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.batch import FAILED, JOURNAL, BatchRow
from facestage.contract.camera import Camera
from facestage.contract.corrections import Correction, write_corrections
from facestage.contract.events import Event
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import FROZEN, OFF, LightStage, fibonacci_stage
from facestage.contract.person import Person, PersonPhoto
from facestage.contract.reflectance import ReflectanceField
from facestage.contract.relight_cache import RelightCache, relight_fingerprint
from facestage.contract.result import CONVERGED, Result
from facestage.contract.rig_file import RigFile
from facestage.contract.sequence import FRAME_STATUSES, Sequence, SequenceFrame
from facestage.contract.wrinkles import Wrinkles
from fuzz.case import Case
from fuzz.damage.archives import zip_bytes, zip_members
from fuzz.seeds.images import exr
from reference.contract_files import full_job, full_rig
from reference.synthetic_face import synthetic_face

LIGHTS, SIDE = 3, 24


def written(write: Callable[[Path], object]) -> Case:
    """The files that ``write`` leaves in a folder; archives without the time of day."""
    with tempfile.TemporaryDirectory(prefix="facestage-fuzz-") as folder:
        write(Path(folder))
        case = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(Path(folder).rglob("*"))
            if path.is_file()
        }
    return {
        name: zip_bytes(zip_members(data)) if name.endswith(".npz") else data
        for name, data in case.items()
    }


def numbers(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape)


def rigid(seed: int) -> np.ndarray:
    """A rotation and a translation, (4, 4)."""
    rotation, _ = np.linalg.qr(numbers(seed, 3, 3))
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    matrix[:3, 3] = [0.01, -0.02, -0.6]
    return matrix


def camera() -> Camera:
    return Camera(SIDE, SIDE - 4, 60.25, (11.5, 10.0))


def stage() -> LightStage:
    made = fibonacci_stage(LIGHTS, radiance=2.5)
    return replace(made, state=np.array([0, FROZEN, OFF])).with_radiance(made.radiance)


def landmarks() -> Landmarks:
    points = 5 + 12 * np.random.default_rng(1).random((68, 2))
    return Landmarks("ibug68", points.round(3), np.arange(68) % 5 > 0, np.ones(68))


def result() -> Result:
    return Result(
        status=CONVERGED,
        advice="Converged.",
        model="default",
        camera=camera(),
        camera_to_stage=rigid(4),
        model_to_camera=rigid(5),
        identity=numbers(1, 3),
        expression=np.array([0.2, 0.4]),
        albedo=numbers(2, 4),
        specular=np.full((4, 4), 0.5),
        roughness=0.37,
        stage=stage(),
        vertices=numbers(3, 9, 3).astype(np.float32),
        triangles=np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8]], np.int32),
        identity_names=("wide", "tall", "long"),
        expression_names=("jawOpen", "smile"),
        energy={"photo": 1.5},
        errors={"psnr": 31.0},
        timings={"render": 0.25},
        left_out=[{"what": "2 lights", "why": "off", "saved": "time"}],
        unobserved={"identity": ["wide"]},
        null_directions={"count": 1, "of": 9, "by_block": {"pose": 1}, "sentences": ["a"]},
        photo={"size": "24 x 20", "color": "sRGB"},
        model_origin={"name": "a", "license": "b", "source": "c"},
        versions={"numpy": "1"},
        seed=3,
        arrays={"condition": np.array(17.0)},
    )


def job_folders() -> list[Case]:
    def full(folder: Path) -> None:
        photo = folder / "photo.png"
        photo.write_bytes(b"not decoded by the contract")
        full_job(photo, rigid(3), landmarks=landmarks(), camera=camera(), stage=stage()).write_into(
            folder, copy_image=False
        )
        data = json.loads((folder / "job.json").read_text())
        (folder / "job.json").write_text(json.dumps(data | {"image": "photo.png"}))

    def plain(folder: Path) -> None:
        Job(image=Path("photo.png")).write_into(folder, copy_image=False)

    return [written(full), written(plain)]


def result_folders() -> list[Case]:
    return [written(lambda folder: result().write_into(folder))]


def person_folders() -> list[Case]:
    photo = PersonPhoto(1, "a.png", "photo-1", CONVERGED, "Converged.", True, {"psnr": 30.0})
    person = Person(
        CONVERGED,
        "Converged.",
        "default",
        (photo, replace(photo, number=2)),
        numbers(1, 3),
        numbers(2, 2),
        np.full((2, 2), 0.5),
        0.4,
        {"fit": 1.0},
    )
    return [written(person.write_into)]


def sequence_folders() -> list[Case]:
    frames = tuple(
        SequenceFrame(number, number / 24, f"{number}.png", status, "", 1, 0.01, 0.5)
        for number, status in enumerate(FRAME_STATUSES, 1)
    )
    sequence = Sequence(
        CONVERGED,
        "Converged.",
        "film.mp4",
        "default",
        camera(),
        24.0,
        frames,
        (1, 3),
        ("a", "b"),
        ("jawOpen",),
        numbers(1, 2),
        np.abs(numbers(2, len(frames), 1)),
        np.tile(np.eye(4), (len(frames), 1, 1)),
        {"expression": np.ones((len(frames), 1)), "pose": np.ones((len(frames), 6))},
        {"jaw": 0.1},
        {"similarity_mm": 1.0},
        {"total": 2.0},
        corrected=(Correction(2, {"jawOpen": 0.5}, np.eye(4)),),
    )
    changing = replace(
        sequence,
        haemoglobin=numbers(3, len(frames), 2),
        haemoglobin_harmonics=numbers(4, 2, 4),
        haemoglobin_color=numbers(5, 3),
        skin={"haemoglobin": 0.7},
        wrinkles=(Wrinkles("smile", ("jawOpen",)),),
    )
    return [written(sequence.write_into), written(changing.write_into)]


def corrections_files() -> list[Case]:
    given = [
        Correction(3, {"jawOpen": 0.25, "eyeBlink_L": 1.5}, np.eye(4)),
        Correction(7, {"a": -1.0}),
    ]
    return [written(lambda folder: write_corrections(folder / "corrections.json", given))]


def sequence_truths() -> list[Case]:
    vertices = np.stack([tiny_model().vertices - [0, 0, 0.6]] * 2).astype(np.float32)
    arrays = {"vertices": vertices, "expression": np.zeros((2, 1)), "names": np.array(["jawOpen"])}
    return [written(lambda folder: np.savez(folder / "truth.npz", **arrays))]


def landmark_files() -> list[Case]:
    plain = {"scheme": "ibug68", "points": landmarks().points.tolist()}
    mesh = {"scheme": "mediapipe478", "points": (numbers(1, 478, 2)).round(2).tolist()}
    return [
        {"landmarks.json": json.dumps(data).encode()}
        for data in (landmarks().to_json(), plain, mesh)
    ]


def camera_files() -> list[Case]:
    return [{"camera.json": json.dumps(camera().to_json()).encode()}]


def recordings() -> list[Case]:
    head = "Timecode,BlendShapeCount,JawOpen,MouthSmileLeft,HeadYaw"
    lines = [f"23:59:59:{frame}.25,61,0.{frame},0.5,-0.1" for frame in (10, 20, 59)]
    text = "\n".join([head, *lines, "00:00:00:01.000,61,1.0,0.0,0.3", ""])
    return [{"take.csv": text.encode()}]


def manifests() -> list[Case]:
    lines = [
        "photo,name,camera,focal_px",
        "a.png,one,a.json,",
        '"b, c.png;d.png",,,300;400',
        "b.png,,,",
        "b.png,,,",
        "",
    ]
    return [{"photos.csv": "\n".join(lines).encode()}]


def journals() -> list[Case]:
    rows = (
        BatchRow(1, "a", ("/a.png",), CONVERGED, "Well.", "0f", 2.5, {"psnr": 30.0}),
        BatchRow(2, "b", ("/b.png", "/c.png"), FAILED, "No face.", "1f", 0.5),
    )
    return [{JOURNAL: "".join(f"{row.to_line()}\n" for row in rows).encode()}]


def reflectance_fields() -> list[Case]:
    half = fibonacci_stage(6).position
    field = ReflectanceField(
        "default",
        camera(),
        rigid(3),
        np.concatenate([half, -half]),
        np.full(12, np.pi / 3),
        tuple(f"{number}.exr" for number in range(12)),
        4,
    )
    return [written(field.write_into)]


def event_lines() -> list[Case]:
    events = (
        Event("started"),
        Event("progress", "light", 3, 0.1, 2.0, 3.0, 0.5, "a.png", "b"),
        Event("done"),
    )
    return [{"line.json": event.to_line().encode()} for event in events]


def relit_folders() -> list[Case]:
    """Result folders with textures and a relight cache."""

    def write(folder: Path) -> None:
        result().write_into(folder)
        for name in ("albedo.exr", "specular.exr", "roughness.exr"):
            (folder / name).write_bytes(exr(np.full((4, 4, 3), 0.5, np.float32)))
        loaded = Result.load(folder)
        pixels = np.array([3, 4, 97, SIDE * (SIDE - 4) - 1])
        images = 0.2 + 0.1 * np.abs(numbers(3, 3, LIGHTS, len(pixels)))
        made = RelightCache.of_images(
            SIDE, SIDE - 4, pixels, np.ones(len(pixels)), images, 4, relight_fingerprint(loaded)
        )
        made.save(folder)

    return [written(write)]


def render_folders() -> list[Case]:
    """The same with the files that ``facestage render`` takes beside it."""
    lights = {"radiance": [[1.0, 0.5, 0.25]] * LIGHTS}
    weights = {"expression": {"jawOpen": 0.5}, "identity": {"wide": -1.0}}
    extra = {
        "lights.json": json.dumps(lights).encode(),
        "weights.json": json.dumps(weights).encode(),
    }
    return [case | extra for case in relit_folders()]


def tiny_model() -> FaceModel:
    return synthetic_face(12, 14)


def small_default() -> FaceModel:
    """What stands for the default model: with the regions that are carried over from it."""
    model = synthetic_face(23, 23)
    return replace(
        model, regions={**model.regions, "face": np.arange(len(model.vertices), dtype=np.int32)}
    )


def rig() -> RigFile:
    return full_rig(tiny_model())


def rig_files() -> list[Case]:
    without = replace(
        rig(),
        identity_names=(),
        identity_offsets=np.zeros((0, 168, 3)),
        borrow_identity=True,
        marks={},
    )
    return [
        written(lambda folder, made=made: made.save(folder / "rig.npz"))  # type: ignore[misc]
        for made in (rig(), without)
    ]


def face_models() -> list[Case]:
    mixed = replace(tiny_model(), expression_prior=("box", "gaussian", "box"))
    return [
        written(lambda folder, made=made: made.save(folder / "face.npz"))  # type: ignore[misc]
        for made in (tiny_model(), mixed)
    ]


def truth_files() -> list[Case]:
    model = tiny_model()
    lights = fibonacci_stage(2)
    arrays = {
        "vertices": (model.vertices - [0, 0, 0.6]).astype(np.float32),
        "light_position": lights.position,
        "light_direction": lights.direction,
        "light_radiance": lights.radiance,
        "light_corners": lights.corners,
        "albedo": np.full((4, 4, 3), 0.5, np.float32),
    }
    return [
        written(lambda folder: np.savez(folder / "truth.npz", **arrays)),
        written(lambda folder: np.savez(folder / "truth.npz", vertices=arrays["vertices"])),
    ]


def scan_files() -> list[Case]:
    points = np.random.default_rng(0).uniform(-60, 60, (120, 3)).astype(np.float32) - [0, 0, 800]
    arrays = {"vertices": points, "triangles": np.arange(120).reshape(-1, 3)}

    def write(folder: Path, region: np.ndarray) -> None:
        np.savez(folder / "scan.npz", **arrays)
        np.save(folder / "region.npy", region)

    return [
        written(lambda folder: np.savez(folder / "scan.npz", **arrays, face=np.arange(110))),
        written(lambda folder: write(folder, np.arange(110))),
        written(lambda folder: write(folder, np.arange(120) < 110)),
    ]


def memories() -> list[Case]:
    keys = ["/usr/lib/libLLVM.so|5|mitsuba 3 drjit 1", "cuda|550|all|mitsuba 3 drjit 1"]
    return [{"native.json": json.dumps({"works": keys}).encode()}]


def any_json() -> list[Case]:
    data = {"a": [1, 2.5, "x", None, True, {"b": {}}], "c": {"d": [[1, 2], [3, 4]]}}
    return [{"a.json": json.dumps(data).encode()}]


def any_arrays() -> list[Case]:
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b/c": np.arange(3),
        "t": np.array("x"),
        "m": np.array([True, False]),
    }
    packed = written(lambda folder: np.savez(folder / "a.npz", **arrays))
    return [packed, {"a.npz": zip_bytes(zip_members(packed["a.npz"]), 8)}]
