"""``facestage fit``: one photograph, or several of one person."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from facestage.cli.jobs import read_job, read_jobs
from facestage.cli.photo_options import add_photo_options
from facestage.contract.errors import EXIT_DONE


def add_command(commands: Any) -> None:
    """Add ``fit`` to the commands."""
    fit = commands.add_parser(
        "fit",
        help="fit a face to a photograph",
        description="Fit shape, expression, pose, albedo, specular map and light to one "
        "photograph; or one shape and "
        "one skin to several of the same person, with a result for each photo.",
        epilog="Example: facestage fit photo.png --out result --budget 60, or "
        "facestage fit a.png b.png --same-person --out result. "
        "A terminal shows the progress in one line; a pipe or a file gets one JSON object per "
        "line. The result folder appears when all is done.",
    )
    fit.add_argument(
        "image",
        nargs="*",
        type=Path,
        metavar="IMAGE",
        help="PNG or JPEG (sRGB), or EXR (linear); alpha masks pixels; several with --same-person",
    )
    fit.add_argument(
        "--job",
        nargs="+",
        action="extend",
        type=Path,
        default=[],
        metavar="DIR",
        help="a job folder (what the add-on writes) instead of IMAGE and its options; several "
        "with --same-person",
    )
    fit.add_argument(
        "--same-person",
        action="store_true",
        help="the photos show one person: identity and skin are shared; --landmarks, --camera, "
        "--focal-px and --truth are repeated for each photo in the same order (one camera "
        "does for all)",
    )
    fit.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="the result folder; replaced when the fit is done",
    )
    add_photo_options(fit)
    fit.add_argument(
        "--resume",
        action="store_true",
        help="continue from the checkpoint of a stopped fit into the same --out",
    )
    fit.add_argument(
        "--json", action="store_true", help="tell of the progress in JSON on a terminal, too"
    )
    fit.set_defaults(run=run, cancelled=cancelled)


def run(options: argparse.Namespace) -> int:
    """Fit, telling of the progress on standard output."""
    from facestage.cli.terminal import ProgressLine, listener, summary
    from facestage.fit.result.person import fit_person
    from facestage.fit.result.run import fit_job

    with listener(options.json) as emit:
        how = (options.out, options.resume, emit, options.landmark_model)
        if options.same_person:
            fit_person(read_jobs(options), *how)
        else:
            fit_job(read_job(options), *how)
    if isinstance(emit, ProgressLine):
        print(summary(options.out))
    return EXIT_DONE


def cancelled(options: argparse.Namespace) -> str:
    """What a stopped fit says: whether there is a checkpoint to go on from."""
    from facestage.contract.files.partial import has_checkpoint, partial_folder

    if has_checkpoint(partial_folder(options.out.resolve())):
        return "cancelled; the last checkpoint is kept, --resume continues from it."
    return "cancelled before the first checkpoint; run it again to start over."
