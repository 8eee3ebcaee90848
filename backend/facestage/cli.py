"""The command line: parse, call one function, turn errors into one sentence and an exit code."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facestage import __version__
from facestage.contract.errors import CancelledError, FacestageError, InputError
from facestage.contract.quality import GOOD, QUALITIES, describe, parse_budget

if TYPE_CHECKING:
    from facestage.contract.events import Event
    from facestage.contract.job import Job

EXIT_DONE, EXIT_BAD_INPUT = 0, 2
CANCELLED = "cancelled; the last checkpoint is kept, --resume continues from it."
MODELS = (
    "default (built in), ict:PATH (ICT-FaceKit), flame:PATH, bfm:PATH (Basel Face Model), gnm:PATH (GNM Head), "
    "rig:FILE (a mesh exported from Blender) or npz:FILE (any of them as saved by facestage model)"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0 done, 2 bad input, 3 cancelled, 4 no backend."""
    cancelled = []

    def cancel(_number: int, _frame: Any) -> None:
        cancelled.append(True)
        raise CancelledError(CANCELLED)

    signal.signal(signal.SIGTERM, cancel)
    parser = build_parser()
    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except FacestageError as error:
        print(f"facestage: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"facestage: {CANCELLED}", file=sys.stderr)
        return CancelledError.exit_code
    except BrokenPipeError:
        # Whoever listened is gone; without this the interpreter complains once more while closing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CancelledError.exit_code
    except Exception:
        # A library in which the signal's exception rose may turn it into one of its own.
        if not cancelled:
            raise
        print(f"facestage: {CANCELLED}", file=sys.stderr)
        return CancelledError.exit_code


def build_parser() -> argparse.ArgumentParser:
    """The parser of every command; ``--help`` of each shows an example."""
    parser = argparse.ArgumentParser(
        prog="facestage",
        description="From a photograph of a face to a face that can be edited and relit.",
        epilog="Start with: facestage doctor, then facestage fit photo.jpg --out result",
    )
    parser.add_argument("--version", action="version", version=f"facestage {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_fit(commands)
    _add_detect(commands)
    _add_render(commands)
    _add_model(commands)
    _add_bench(commands)
    _add_stress(commands)
    doctor = commands.add_parser("doctor", help="say what works on this machine, and how to mend the rest")
    doctor.set_defaults(run=_run_doctor)
    return parser


def _add_fit(commands: Any) -> None:
    fit = commands.add_parser(
        "fit",
        help="fit a face to a photograph",
        description="Fit shape, expression, pose, albedo, specular map and light to one photograph; or one shape and "
        "one skin to several of the same person, with a result for each photo.",
        epilog="Example: facestage fit photo.png --out result --budget 60, or "
        "facestage fit a.png b.png --same-person --out result. "
        "Progress comes as one JSON object per line on stdout; the result folder appears when all is done.",
    )
    fit.add_argument(
        "image", nargs="*", type=Path, metavar="IMAGE",
        help="PNG or JPEG (sRGB), or EXR (linear); alpha masks pixels; several with --same-person",
    )  # fmt: skip
    fit.add_argument(
        "--job", nargs="+", action="extend", type=Path, default=[], metavar="DIR",
        help="a job folder (what the add-on writes) instead of IMAGE and its options; several with --same-person",
    )  # fmt: skip
    fit.add_argument(
        "--same-person", action="store_true",
        help="the photos show one person: identity and skin are shared; --landmarks, --camera, "
        "--focal-px and --truth are repeated for each photo in the same order (one camera does for all)",
    )  # fmt: skip
    fit.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="the result folder; replaced when the fit is done"
    )
    fit.add_argument("--model", metavar="MODEL", help=f"face model: {MODELS}")
    fit.add_argument(
        "--landmarks", action="append", type=Path, metavar="FILE",
        help='{"scheme": "ibug68", "points": [[x, y], ...], "visible": [...]}; without it a face is found in the photo',
    )  # fmt: skip
    _add_finding(fit)
    camera = fit.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera",
        action="append",
        type=Path,
        metavar="FILE",
        help='{"width":, "height":, "focal_px":, "principal_px": [cx, cy]}',
    )
    camera.add_argument(
        "--focal-px",
        action="append",
        type=float,
        metavar="F",
        help="focal length in pixels; fitted when neither is given",
    )
    fit.add_argument("--lights", type=int, metavar="N", help="area lights of the virtual stage (default 20)")
    fit.add_argument(
        "--light-color", choices=("multi", "uniform"), help="a color for each light (default), or one for all"
    )
    fit.add_argument(
        "--freeze", nargs="+", action="extend", default=[], metavar="NAME",
        help="do not fit: identity, expression, pose, albedo, ...",
    )  # fmt: skip
    fit.add_argument(
        "--budget", metavar="SECONDS|NAME",
        help="seconds from the first step on, pictures included; or a quality: "
        + "; ".join(f"{name} ({describe(name)})" for name in QUALITIES) + f" (default: {GOOD}, as long as it takes)",
    )  # fmt: skip
    fit.add_argument("--seed", type=int, metavar="N", help="seed of the light samples (default 0)")
    fit.add_argument("--device", choices=("auto", "cpu", "cuda"), help="where to trace rays (default auto)")
    fit.add_argument(
        "--truth",
        action="append",
        type=Path,
        metavar="FILE",
        help="known vertices (.npz): adds errors to trace and result, changes nothing",
    )
    fit.add_argument(
        "--plan", choices=("lean", "full"),
        help="lean (default) leaves out what the scene does not need; full works on everything, to check that the "
        "answer is the same",
    )  # fmt: skip
    fit.add_argument(
        "--resume", action="store_true", help="continue from the checkpoint of a stopped fit into the same --out"
    )
    fit.set_defaults(run=_run_fit)


def _add_detect(commands: Any) -> None:
    detect = commands.add_parser(
        "detect",
        help="find the landmarks of a face in a photograph",
        description="Find faces in a photograph and write 478 landmarks (scheme mediapipe478) of one of them, each "
        "marked visible or hidden. A fit without --landmarks does the same; detect on its own shows what it would use, "
        "and its file can be mended by hand. Prints a line of JSON: which face, how sure (0 to 1), its box in pixels.",
        epilog="Example: facestage detect group.jpg --out points.json --picture points.png, then look at the picture, "
        "and choose with --face 2. The model (3.7 MB) is fetched on first use; facestage doctor says whether it is "
        "there.",
    )
    detect.add_argument("image", type=Path, metavar="IMAGE", help="PNG or JPEG (sRGB), or EXR (linear)")
    detect.add_argument("--out", type=Path, required=True, metavar="FILE", help="landmarks.json to write")
    _add_finding(detect)
    detect.add_argument(
        "--picture", type=Path, metavar="FILE",
        help="write the photo (.png) with the points drawn: green seen, red hidden, a numbered box for every face",
    )  # fmt: skip
    detect.add_argument("--all", action="store_true", help="write the points of every face found, under 'faces'")
    detect.set_defaults(run=_run_detect)


def _add_finding(command: Any) -> None:
    """The options of every command that finds faces."""
    command.add_argument(
        "--face", type=int, metavar="K", help="which face of several: 1 is the largest (default), 2 the next, ..."
    )
    command.add_argument(
        "--landmark-model", type=Path, metavar="FILE",
        help="MediaPipe's face_landmarker.task (default: $FACESTAGE_LANDMARK_MODEL, the cache, else fetched once)",
    )  # fmt: skip


def _add_render(commands: Any) -> None:
    render = commands.add_parser(
        "render",
        help="render a fitted face, relit or with another expression",
        description="Other lights come from the result's relight cache (relight.npz), in milliseconds; the first "
        "picture under other lights makes it when the fit has not.",
        epilog="Example: facestage render result --out relit.png --lights lights.json --weights smile.json",
    )
    render.add_argument("result", type=Path, metavar="RESULT", help="a result folder of facestage fit")
    render.add_argument("--out", type=Path, metavar="FILE", help="picture to write: .exr (linear) or .png (sRGB)")
    render.add_argument(
        "--lights", type=Path, metavar="FILE", help='{"radiance": [[r, g, b], ...]}, one row per light of the stage'
    )
    render.add_argument(
        "--weights", type=Path, metavar="FILE", help='{"expression": {name: weight}, "identity": {name: weight}}'
    )
    render.add_argument(
        "--spp", type=int, metavar="N", help="at least so many shadow samples per light (default: the cache's, else 16)"
    )
    render.add_argument(
        "--cache",
        action="store_true",
        help="make the relight cache anew, with or without a picture (what the add-on asks)",
    )
    render.set_defaults(run=_run_render)


def _add_model(commands: Any) -> None:
    model = commands.add_parser(
        "model",
        help="say what a face model holds and under what licence, and write it in Facestage's own form",
        description="Print a face model's name, licence, source and sizes as one line of JSON; with --out also write "
        "it in Facestage's own form (what the add-on builds rigs from). docs/face-models.md says how to get each.",
        epilog="Example: facestage model flame:generic_model.pkl --out flame.npz",
    )
    model.add_argument("model", metavar="MODEL", help=MODELS)
    model.add_argument("--out", type=Path, metavar="FILE", help=".npz to write")
    model.set_defaults(run=_run_model)


def _add_bench(commands: Any) -> None:
    bench = commands.add_parser(
        "bench",
        help="measure error against run time, beside Mitsuba + Adam and spherical harmonics",
        description="Fit cases with known truth by Facestage, by the same energy with plain Mitsuba and Adam, and by "
        "spherical harmonics without shadows or highlights; draw error against seconds and print how long each needs "
        "to reach an error. About ten minutes with two CPU cores; leave the machine alone meanwhile.",
        epilog="Example: facestage bench --quick --out bench, or facestage bench --case photos/anna photos/ben "
        "--model ict:ict-facekit.tar.xz. Without --case: the cases in $FACESTAGE_DATA/cases, else a synthetic photo.",
    )
    bench.add_argument(
        "--case", nargs="+", action="extend", type=Path, default=[], metavar="DIR",
        help="folders with photo.png, landmarks.json, camera.json and truth.npz (vertices, in the camera frame)",
    )  # fmt: skip
    bench.add_argument("--model", metavar="MODEL", help=f"face model that the truth belongs to: {MODELS}")
    bench.add_argument(
        "--out", type=Path, default=Path("out/bench"), metavar="DIR",
        help="where bench.html, the pictures and the CSV files go (default: out/bench)",
    )  # fmt: skip
    bench.add_argument(
        "--plan", action="store_true",
        help="instead: fit three scenes with and without what the plan leaves out, and print what it saves",
    )  # fmt: skip
    bench.add_argument("--quick", action="store_true", help="one case, three contenders, one to two minutes")
    bench.add_argument(
        "--alone", action="store_true",
        help="fit the cases by Facestage alone, and say whether one ended worse than its own landmark stage",
    )  # fmt: skip
    bench.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the light samples (default 0)")
    bench.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto", help="where to trace rays")
    bench.set_defaults(run=_run_bench)


def _add_stress(commands: Any) -> None:
    stress = commands.add_parser(
        "stress",
        help="run stiff and extreme cases through the fit, and say what came of each",
        description="Fit small synthetic photos with known truth under stiff and extreme conditions, each in a process "
        "of its own: grazing light, NaN pixels, wrong landmarks, a stage 1000 km from its origin, ... A case may "
        "converge, stop with advice, or refuse in a sentence. The exit code is 1 when one is NaN, hangs, crashes, or "
        "claims to have converged beyond the bounds that the case states.",
        epilog="Example: facestage stress --out stress, or facestage stress --case grazing-light yaw-90. "
        "All cases take about ten minutes on two cores.",
    )
    stress.add_argument(
        "--out", type=Path, metavar="DIR",
        help="write the table there as stress.html, .txt and .json, and keep the files of cases at fault",
    )  # fmt: skip
    stress.add_argument(
        "--case", nargs="+", action="extend", default=[], metavar="NAME", help="only these cases (default: all)"
    )
    stress.add_argument("--list", action="store_true", help="print the names of the cases and what each stresses")
    stress.set_defaults(run=_run_stress)


def _check_paths(options: argparse.Namespace) -> None:
    """Raise InputError for a path that no machine has, whichever option it belongs to."""
    from facestage.contract.paths import user_path

    for name, value in vars(options).items():
        for path in value if isinstance(value, list) else [value]:
            if isinstance(path, Path):
                user_path(path, f"path given as {name.replace('_', ' ')}")


def _run_fit(options: argparse.Namespace) -> int:
    _check_paths(options)
    from facestage.fit.person import fit_person
    from facestage.fit.run import fit_job

    def emit(event: Event) -> None:
        print(event.to_line(), flush=True)

    if options.same_person:
        fit_person(_jobs(options), options.out, options.resume, emit, options.landmark_model)
    else:
        fit_job(_job(options), options.out, options.resume, emit, options.landmark_model)
    return EXIT_DONE


def _job(options: argparse.Namespace) -> Job:
    """The job of a ``fit`` command line that is about one photo."""
    jobs = _jobs(options)
    if len(jobs) > 1:
        raise InputError(
            f"{len(jobs)} photos were given; add --same-person to fit one shape and skin to all of them, or fit them "
            "one by one."
        )
    return jobs[0]


def _jobs(options: argparse.Namespace) -> list[Job]:
    """The jobs of a ``fit`` command line, from job folders or from the images and their options."""
    from facestage.contract.job import Job

    count = len(options.job) or len(options.image)
    if options.job:
        own = ("image", "model", "landmarks", "camera", "focal_px", "lights", "light_color", "seed", "device", "face")
        given = [name for name in own if getattr(options, name) not in (None, [])]
        if given or options.freeze:
            raise InputError(
                f"--job already says what to fit; leave out {(given or ['freeze'])[0]}, or change it in the job."
            )
        jobs = [Job.load(folder) for folder in options.job]
    elif not options.image:
        raise InputError("facestage fit needs a photo or a job: facestage fit IMAGE --out DIR, or --job DIR --out DIR.")
    else:
        landmarks = _for_each(options.landmarks, count, "landmark files")
        cameras = _for_each(options.camera, count, "camera files", one_for_all=True)
        focals = _for_each(options.focal_px, count, "focal lengths", one_for_all=True)
        jobs = [_image_job(options, *own) for own in zip(options.image, landmarks, cameras, focals, strict=True)]
    truths = _for_each(options.truth, count, "truth files")
    return [_override(job, options, truth) for job, truth in zip(jobs, truths, strict=True)]


def _for_each(values: list[Any] | None, count: int, what: str, one_for_all: bool = False) -> list[Any]:
    """One value per photo; None for each when none was given."""
    if not values:
        return [None] * count
    if one_for_all and len(values) == 1:
        return values * count
    if len(values) != count:
        raise InputError(
            f"{len(values)} {what} were given for {count} photo{'' if count == 1 else 's'}; expected one for each, in "
            "the order of the photos."
        )
    return values


def _override(job: Job, options: argparse.Namespace, truth: Path | None) -> Job:
    from dataclasses import replace

    if options.budget is not None:
        seconds, quality = parse_budget(options.budget)
        job = replace(job, budget_seconds=seconds, quality=quality)
    if truth is not None:
        job = replace(job, truth=truth.absolute())
    if options.plan is not None:
        job = replace(job, plan=options.plan)
    return job


def _image_job(
    options: argparse.Namespace, image: Path, landmarks: Path | None, camera_file: Path | None, focal_px: float | None
) -> Job:
    from facestage.contract.camera import Camera
    from facestage.contract.job import Job
    from facestage.contract.landmarks import Landmarks
    from facestage.contract.light_stage import DEFAULT_COUNT, fibonacci_stage
    from facestage.image_io import read_photograph

    camera = Camera.read(camera_file) if camera_file else None
    if focal_px is not None:
        camera = Camera.default(*read_photograph(image).size, focal_px)
    count = DEFAULT_COUNT if options.lights is None else options.lights
    return Job(
        image=image.absolute(),
        model=options.model or "default",
        landmarks=Landmarks.read(landmarks) if landmarks else None,
        camera=camera,
        stage=fibonacci_stage(count),
        light_color=options.light_color or "multi",
        freeze=tuple(options.freeze),
        seed=options.seed or 0,
        device=options.device or "auto",
        face=options.face,
    )


def _run_detect(options: argparse.Namespace) -> int:
    _check_paths(options)
    from facestage.landmarks.command import run_detect

    summary = run_detect(options.image, options.out, options.face, options.landmark_model, options.picture, options.all)
    print(json.dumps(summary))
    return EXIT_DONE


def _run_render(options: argparse.Namespace) -> int:
    _check_paths(options)
    from facestage.fit.relight import make_cache, render_result

    if options.out is None and not options.cache:
        raise InputError("facestage render has nothing to write; give --out FILE, or --cache for the relight cache.")
    lights = _read(options.lights, "light file")
    weights = _read(options.weights, "weight file")
    if options.cache:
        make_cache(options.result, options.spp)
    if options.out is not None:
        render_result(options.result, options.out, lights, weights, options.spp)
    return EXIT_DONE


def _read(path: Path | None, what: str) -> dict[str, Any] | None:
    from facestage.contract.storage import read_json

    return read_json(path, what) if path is not None else None


def _run_model(options: argparse.Namespace) -> int:
    _check_paths(options)
    from facestage.models.registry import load_model

    if options.out is not None and options.out.suffix != ".npz":
        raise InputError(f"The output '{options.out}' does not end in .npz; a face model is written as one .npz file.")
    model = load_model(options.model)
    if options.out is not None:
        model.save(options.out)
    summary = {
        "name": model.name, "license": model.license, "source": model.source, "vertices": len(model.vertices),
        "identity": len(model.identity_names), "expression": len(model.expression_names),
        "albedo": len(model.albedo_basis), "landmarks": sorted(model.landmarks),
    }  # fmt: skip
    print(json.dumps(summary))
    return EXIT_DONE


def _run_bench(options: argparse.Namespace) -> int:
    _check_paths(options)
    if options.plan and options.case:
        raise InputError("bench --plan renders its own scenes; leave out --case, or leave out --plan.")
    if options.plan:
        from facestage.bench.plan_savings import run_plan_savings

        return run_plan_savings(options.model, options.out, options.quick, sys.stdout, options.device, options.seed)
    from facestage.bench.run import run_bench

    return run_bench(
        options.case, options.model, options.out, options.quick, sys.stdout, options.device, options.seed,
        options.alone,
    )  # fmt: skip


def _run_stress(options: argparse.Namespace) -> int:
    _check_paths(options)
    from facestage.stress.run import list_cases, run_stress

    return list_cases(sys.stdout) if options.list else run_stress(options.case, options.out, sys.stdout)


def _run_doctor(_options: argparse.Namespace) -> int:
    from facestage.doctor import run_doctor

    return run_doctor(sys.stdout)


if __name__ == "__main__":
    sys.exit(main())
