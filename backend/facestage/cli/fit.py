"""``facestage fit``: one photograph, or several of one person."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from facestage.cli.common import MODELS, add_finding
from facestage.cli.jobs import read_job, read_jobs
from facestage.contract.errors import EXIT_DONE
from facestage.contract.quality import GOOD, QUALITIES, describe


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
    fit.add_argument("--model", metavar="MODEL", help=f"face model: {MODELS}")
    fit.add_argument(
        "--landmarks",
        action="append",
        type=Path,
        metavar="FILE",
        help='{"scheme": "ibug68", "points": [[x, y], ...], "visible": [...]}; without it a '
        "face is found in the photo",
    )
    add_finding(fit)
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
    fit.add_argument(
        "--lights", type=int, metavar="N", help="area lights of the virtual stage (default 20)"
    )
    fit.add_argument(
        "--environment",
        metavar="FILE.exr[@DEGREES]",
        help="the photo's surroundings, where they are known, instead of fitted lights: a "
        "latitude-longitude map of linear radiance (OpenEXR, any exposure) with the zenith above, "
        "turned so many degrees about the vertical",
    )
    fit.add_argument(
        "--surround",
        choices=("auto", "on", "off"),
        help="lights behind the face beside those of the stage: where the photo needs them "
        "(auto, default), always or never",
    )
    fit.add_argument(
        "--white-balance",
        action="append",
        metavar="X,Y|R,G,B",
        help="what is grey or white in the photo, in the light that falls on the face: its pixel, "
        "from the upper left corner, or the linear color that it shows. Without it, the color of "
        "the light, and with it the skin's, is a guess",
    )
    fit.add_argument(
        "--texture-size",
        type=int,
        choices=(512, 1024, 2048, 4096),
        help="the most texels along the textures (default 2048); as many as the photo fills are "
        "made: 4096 takes a face of 700 pixels and more, several times the time and 3.3 GB",
    )
    fit.add_argument(
        "--light-color",
        choices=("multi", "uniform"),
        help="a color for each light (default), or one for all",
    )
    fit.add_argument(
        "--freeze",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="do not fit: identity, expression, pose, albedo, ...",
    )
    fit.add_argument(
        "--budget",
        metavar="SECONDS|NAME",
        help="seconds from the first step on, pictures included; or a quality: "
        + "; ".join(f"{name} ({describe(name)})" for name in QUALITIES)
        + f" (default: {GOOD}, as long as it takes)",
    )
    fit.add_argument("--seed", type=int, metavar="N", help="seed of the light samples (default 0)")
    fit.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), help="where to trace rays (default auto)"
    )
    fit.add_argument(
        "--truth",
        action="append",
        type=Path,
        metavar="FILE",
        help="what is known of the shape (.npz): adds errors to the result, changes nothing; the "
        "face model's own vertices in metres, or a scan: vertices (millimetres) and triangles, "
        "both in the camera's frame (x right, y up, looking along -z)",
    )
    fit.add_argument(
        "--face-region",
        action="append",
        type=Path,
        metavar="FILE.npy",
        help="which vertices of a scan given as --truth are its face: their numbers, or true and "
        "false for each (default: the scan's own array 'face', or face_region.npy beside it); "
        "one does for several photos",
    )
    fit.add_argument(
        "--plan",
        choices=("lean", "full"),
        help="lean (default) leaves out what the scene does not need; full works on "
        "everything, to check that the "
        "answer is the same",
    )
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
