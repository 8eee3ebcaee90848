"""``facestage bench``: error against run time."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from facestage.cli.common import MODELS
from facestage.contract.errors import InputError
from facestage.system.cores import use_algebra_threads


def add_command(commands: Any) -> None:
    """Add ``bench`` to the commands."""
    bench = commands.add_parser(
        "bench",
        help="measure error against run time, beside Mitsuba + Adam and spherical harmonics",
        description="Fit cases with known truth by Facestage, by the same energy with plain "
        "Mitsuba and Adam, and by "
        "spherical harmonics without shadows or highlights; draw error against seconds and "
        "print how long each needs "
        "to reach an error. About ten minutes with two CPU cores; leave the machine alone "
        "meanwhile.",
        epilog="Example: facestage bench --quick --out bench, or facestage bench --case "
        "photos/anna photos/ben "
        "--model ict:ict-facekit.tar.xz. Without --case: the cases in $FACESTAGE_DATA/cases, "
        "else a synthetic photo.",
    )
    bench.add_argument(
        "--case",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="DIR",
        help="folders with photo.png, camera.json, landmarks.json and truth.npz (vertices of the "
        "face model, in the camera frame), or with scan.npz (vertices in millimetres and "
        "triangles of any scan, in the camera frame) instead of the last: then landmarks may be "
        "missing and are found, and errors are medians of the distance of the scan's face points "
        "from the fitted mesh",
    )
    bench.add_argument(
        "--face-region",
        type=Path,
        metavar="FILE.npy",
        help="which vertices of the cases' scans are the face (default: each scan's own array "
        "'face', or face_region.npy beside it)",
    )
    bench.add_argument(
        "--model", metavar="MODEL", help=f"face model that the truth belongs to: {MODELS}"
    )
    bench.add_argument(
        "--out",
        type=Path,
        default=Path("out/bench"),
        metavar="DIR",
        help="where bench.html, the pictures and the CSV files go (default: out/bench)",
    )
    bench.add_argument(
        "--plan",
        action="store_true",
        help="instead: fit three scenes with and without what the plan leaves out, and print "
        "what it saves",
    )
    bench.add_argument(
        "--sequence",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="DIR",
        help="instead: follow films, folders of pictures with truth.npz (as of facestage track) "
        "and perhaps camera.json, and print the errors by landmarks alone, of MediaPipe's own "
        "weights (with LiteRT) and with pictures; with --quick, pictures are looked at once",
    )
    bench.add_argument(
        "--quick", action="store_true", help="one case, three contenders, one to two minutes"
    )
    bench.add_argument(
        "--alone",
        action="store_true",
        help="fit the cases by Facestage alone, and say whether one ended worse than its own "
        "landmark stage",
    )
    bench.add_argument(
        "--parts",
        action="store_true",
        help="fit the cases by Facestage alone, whole and without each part of the light's model "
        "(lights behind the face, light from skin to skin, below the skin, unevenly out of it), "
        "and say what each costs a step and gains",
    )
    bench.add_argument(
        "--seed", type=int, default=0, metavar="N", help="seed of the light samples (default 0)"
    )
    bench.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), default="auto", help="where to trace rays"
    )
    bench.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Measure, and print the table."""
    if options.face_region is not None and not options.case:
        raise InputError(
            "--face-region is about the scans of cases; give the cases with --case, or leave it "
            "out."
        )
    if options.parts and (options.alone or options.quick or options.plan):
        raise InputError(
            "bench --parts says by itself which fits it compares; leave out --alone, --quick and "
            "--plan."
        )
    if options.plan and options.case:
        raise InputError(
            "bench --plan renders its own scenes; leave out --case, or leave out --plan."
        )
    if options.sequence and (options.case or options.plan or options.parts or options.alone):
        raise InputError(
            "bench --sequence follows films alone; leave out --case, --plan, --parts and --alone."
        )
    if options.sequence:
        use_algebra_threads(1)
        from facestage.bench.following import run_sequence_bench

        return run_sequence_bench(
            options.sequence,
            options.model,
            options.out,
            options.quick,
            sys.stdout,
            device=options.device,
            seed=options.seed,
        )
    if options.plan:
        from facestage.bench.plan_savings import run_plan_savings

        return run_plan_savings(
            options.model, options.out, options.quick, sys.stdout, options.device, options.seed
        )
    from facestage.bench.run import run_bench

    return run_bench(
        options.case,
        options.model,
        options.out,
        options.quick,
        sys.stdout,
        device=options.device,
        seed=options.seed,
        alone=options.alone,
        parts=options.parts,
        face_region=options.face_region,
    )
