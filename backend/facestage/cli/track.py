"""``facestage track``: a performance from a video or a folder of frames."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facestage.cli.common import MODELS, add_finding
from facestage.cli.film_options import add_film_options, read_request
from facestage.contract.errors import EXIT_DONE, InputError
from facestage.contract.quality import GOOD
from facestage.system.cores import use_algebra_threads

if TYPE_CHECKING:
    from facestage.contract.events import Event

# What a sequence was tracked with, and is fitted again with.
OF_TRACKING: dict[str, object] = {
    "rate": None,
    "model": "default",
    "face": None,
    "camera": None,
    "focal_px": None,
    "landmarks_only": False,
    "freeze": [],
    "budget": GOOD,
    "seed": 0,
    "vertices": False,
    "resume": False,
}


def add_command(commands: Any) -> None:
    """Add ``track`` to the commands."""
    track = commands.add_parser(
        "track",
        help="follow a face through a film",
        description="Find one person in a film, and the head's pose and the expression in every "
        "frame. A few frames that differ most are fitted together first: they say who it is, and "
        "in which light. Then every frame is compared with its picture, and all frames are "
        "smoothed together, forwards and backwards, with as much smoothness as the film shows.",
        epilog="Example: facestage track take.mp4 --out take, or facestage track frames --rate 25 "
        "--camera camera.json --out take. Ctrl+C keeps what is done, --resume goes on from there. "
        "The folder holds sequence.json, sequence.npz, the texture maps, the results of the "
        "keyframes and report.html; docs/sequences.md describes them.",
    )
    track.add_argument(
        "film",
        type=Path,
        metavar="VIDEO|FOLDER",
        help="a video, or a folder of pictures in the order of their numbers",
    )
    track.add_argument("--out", type=Path, required=True, metavar="DIR", help="the folder to write")
    add_film_options(track)
    track.add_argument("--model", default="default", metavar="MODEL", help=f"face model: {MODELS}")
    add_finding(track)
    camera = track.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera",
        type=Path,
        metavar="FILE",
        help='{"width":, "height":, "focal_px":, "principal_px": [cx, cy]}, of every frame',
    )
    camera.add_argument(
        "--focal-px",
        type=float,
        metavar="F",
        help="focal length in pixels; fitted to the keyframes when neither is given",
    )
    track.add_argument(
        "--freeze",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="do not fit: identity, expression, albedo, lights, ...",
    )
    track.add_argument(
        "--budget",
        default=GOOD,
        metavar="SECONDS|NAME",
        help="seconds for all of it; or how often the pictures are looked at: draft (once), "
        "good (three times, default) or best (seven times)",
    )
    track.add_argument("--seed", type=int, default=0, metavar="N", help="of the light samples")
    track.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), default="auto", help="where to trace rays"
    )
    track.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="what is known (.npz): vertices (frames, n, 3) in the camera's frame, perhaps "
        "expression (frames, e) and names; adds errors to the result, changes nothing",
    )
    track.add_argument(
        "--resume",
        action="store_true",
        help="continue from the checkpoint of a stopped run into the same --out",
    )
    again = track.add_argument_group("fitting again around frames corrected by hand")
    again.add_argument(
        "--corrected",
        type=Path,
        metavar="FILE",
        help="weights and poses of single frames that are known (.json, see docs/sequences.md): "
        "the sequence in --out is fitted again around them, and written anew",
    )
    again.add_argument(
        "--frames",
        metavar="A:B",
        help="numbers of the first and the last frame that --corrected may change (default: half "
        "a second around the corrected ones)",
    )
    track.add_argument(
        "--json", action="store_true", help="tell of the progress in JSON on a terminal, too"
    )
    track.set_defaults(run=run, cancelled=cancelled)


def run(options: argparse.Namespace) -> int:
    """Track, telling of the progress on standard output."""
    # Films have smaller matrices still, and processes for the cores.
    use_algebra_threads(1)
    from facestage.cli.terminal import ProgressLine, listener, track_summary

    work = _refit if options.corrected is not None else _track
    with listener(options.json) as emit:
        work(options, emit)
    if isinstance(emit, ProgressLine):
        print(track_summary(options.out))
    return EXIT_DONE


def _track(options: argparse.Namespace, emit: Callable[[Event], None]) -> None:
    from facestage.fit.sequence.run import track_film

    if options.frames is not None:
        raise InputError("--frames says what --corrected may change; give that too.")
    request = read_request(options)
    track_film(request, options.out, options.resume, emit, options.landmark_model)


def _refit(options: argparse.Namespace, emit: Callable[[Event], None]) -> None:
    from facestage.contract.corrections import read_corrections
    from facestage.fit.correction.refit import RefitRequest, refit
    from facestage.fit.correction.span import FrameRange

    given = [name for name, usual in OF_TRACKING.items() if getattr(options, name) != usual]
    if given:
        raise InputError(
            f"--corrected fits a sequence again as it was tracked; leave out "
            f"--{given[0].replace('_', '-')}."
        )
    request = RefitRequest(
        film=options.film,
        corrections=read_corrections(options.corrected),
        frames=None if options.frames is None else FrameRange.parse(options.frames),
        truth=options.truth,
        landmark_model=options.landmark_model,
        device=options.device,
    )
    refit(request, options.out, emit)


def cancelled(options: argparse.Namespace) -> str:
    """What a stopped run says: whether there is a checkpoint to go on from."""
    from facestage.contract.files.partial import has_checkpoint, partial_folder

    if options.corrected is not None:
        return "cancelled; the sequence is as it was."
    if has_checkpoint(partial_folder(options.out.resolve())):
        return "cancelled; what is done is kept, --resume continues from it."
    return "cancelled before the first checkpoint; run it again to start over."
