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
        epilog="Start with: facestage doctor, then facestage fit photo.jpg --landmarks points.json --out result",
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
        description="Fit shape, expression, pose, albedo, specular map and light to one photograph.",
        epilog="Example: facestage fit photo.png --landmarks points.json --out result --budget 60. "
        "Progress comes as one JSON object per line on stdout; the result folder appears when all is done.",
    )
    fit.add_argument(
        "image", nargs="?", type=Path, metavar="IMAGE", help="PNG or JPEG (sRGB), or EXR (linear); alpha masks pixels"
    )
    fit.add_argument(
        "--job", type=Path, metavar="DIR", help="a job folder (what the add-on writes) instead of IMAGE and its options"
    )
    fit.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="the result folder; replaced when the fit is done"
    )
    fit.add_argument("--model", metavar="MODEL", help=f"face model: {MODELS}")
    fit.add_argument(
        "--landmarks", type=Path, metavar="FILE", help='{"scheme": "ibug68", "points": [[x, y], ...], "visible": [...]}'
    )
    camera = fit.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera", type=Path, metavar="FILE", help='{"width":, "height":, "focal_px":, "principal_px": [cx, cy]}'
    )
    camera.add_argument(
        "--focal-px", type=float, metavar="F", help="focal length in pixels; fitted when neither is given"
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
    detect = commands.add_parser("detect", help="find the landmarks of a face in a photograph")
    detect.add_argument("image", type=Path, metavar="IMAGE")
    detect.add_argument("--out", type=Path, required=True, metavar="FILE", help="landmarks.json to write")
    detect.set_defaults(run=_run_detect)


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


def _run_fit(options: argparse.Namespace) -> int:
    from facestage.fit.run import fit_job

    fit_job(_job(options), options.out, options.resume, lambda event: print(event.to_line(), flush=True))
    return EXIT_DONE


def _job(options: argparse.Namespace) -> Job:
    """The job of a ``fit`` command line, from a job folder or from the image and its options."""
    from facestage.contract.job import Job

    if options.job is not None:
        own = ("image", "model", "landmarks", "camera", "focal_px", "lights", "light_color", "seed", "device")
        given = [name for name in own if getattr(options, name) is not None]
        if given or options.freeze:
            raise InputError(
                f"--job already says what to fit; leave out {(given or ['freeze'])[0]}, or change it in the job."
            )
        job = Job.load(options.job)
        return _override(job, options)
    if options.image is None:
        raise InputError("facestage fit needs a photo or a job: facestage fit IMAGE --out DIR, or --job DIR --out DIR.")
    return _override(_image_job(options), options)


def _override(job: Job, options: argparse.Namespace) -> Job:
    from dataclasses import replace

    if options.budget is not None:
        seconds, quality = parse_budget(options.budget)
        job = replace(job, budget_seconds=seconds, quality=quality)
    if options.truth is not None:
        job = replace(job, truth=options.truth.absolute())
    if options.plan is not None:
        job = replace(job, plan=options.plan)
    return job


def _image_job(options: argparse.Namespace) -> Job:
    from facestage.contract.camera import Camera
    from facestage.contract.job import Job
    from facestage.contract.landmarks import Landmarks
    from facestage.contract.light_stage import DEFAULT_COUNT, fibonacci_stage
    from facestage.image_io import read_photograph

    camera = Camera.read(options.camera) if options.camera else None
    if options.focal_px is not None:
        camera = Camera.default(*read_photograph(options.image).size, options.focal_px)
    count = DEFAULT_COUNT if options.lights is None else options.lights
    return Job(
        image=options.image.absolute(),
        model=options.model or "default",
        landmarks=Landmarks.read(options.landmarks) if options.landmarks else None,
        camera=camera,
        stage=fibonacci_stage(count),
        light_color=options.light_color or "multi",
        freeze=tuple(options.freeze),
        seed=options.seed or 0,
        device=options.device or "auto",
    )


def _run_detect(_options: argparse.Namespace) -> int:
    raise InputError(
        "Automatic landmark detection is not available; make a landmark file by hand or with another tool and "
        "give it with --landmarks (68 points, scheme ibug68)."
    )


def _run_render(options: argparse.Namespace) -> int:
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
    from facestage.stress.run import list_cases, run_stress

    return list_cases(sys.stdout) if options.list else run_stress(options.case, options.out, sys.stdout)


def _run_doctor(_options: argparse.Namespace) -> int:
    from facestage.doctor import run_doctor

    return run_doctor(sys.stdout)


if __name__ == "__main__":
    sys.exit(main())
