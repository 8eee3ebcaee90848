"""``facestage detect``: the landmarks of a face in a photograph."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from facestage.cli.common import add_finding
from facestage.contract.errors import EXIT_DONE


def add_command(commands: Any) -> None:
    """Add ``detect`` to the commands."""
    detect = commands.add_parser(
        "detect",
        help="find the landmarks of a face in a photograph",
        description="Find faces in a photograph and write 478 landmarks (scheme mediapipe478) "
        "of one of them, each "
        "marked visible or hidden. A fit without --landmarks does the same; detect on its own "
        "shows what it would use, "
        "and its file can be mended by hand. Prints a line of JSON: which face, how sure (0 "
        "to 1), its box in pixels.",
        epilog="Example: facestage detect group.jpg --out points.json --picture points.png, "
        "then look at the picture, "
        "and choose with --face 2. The model (3.7 MB) is fetched on first use; facestage "
        "doctor says whether it is "
        "there.",
    )
    detect.add_argument(
        "image", type=Path, metavar="IMAGE", help="PNG or JPEG (sRGB), or EXR (linear)"
    )
    detect.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="landmarks.json to write"
    )
    add_finding(detect)
    detect.add_argument(
        "--picture",
        type=Path,
        metavar="FILE",
        help="write the photo (.png) with the points drawn: green seen, red hidden, a "
        "numbered box for every face",
    )
    detect.add_argument(
        "--all", action="store_true", help="write the points of every face found, under 'faces'"
    )
    detect.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the landmarks, and print which face was taken."""
    from facestage.landmarks.command import run_detect

    summary = run_detect(
        options.image,
        options.out,
        options.face,
        options.landmark_model,
        options.picture,
        options.all,
    )
    print(json.dumps(summary))
    return EXIT_DONE
