"""``facestage reflectance``: a fitted face under light from each direction alone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from facestage.contract.errors import EXIT_DONE

DIRECTIONS, SAMPLES = 400, 16  # by default


def add_command(commands: Any) -> None:
    """Add ``reflectance`` to the commands."""
    reflectance = commands.add_parser(
        "reflectance",
        help="render a fitted face under light from each of many directions alone",
        description="Write the reflectance field of a fitted face (Debevec et al. 2000): a linear "
        "EXR for each direction of distant light, and reflectance.json with the directions, their "
        "solid angles (their sum is 4 pi) and the frame. Any distant light is a sum of these "
        "pictures.",
        epilog="Example: facestage reflectance result --out field, then facestage render field "
        "--environment sky.exr@40 --out relit.exr. docs/light.md says how exact that is.",
    )
    reflectance.add_argument(
        "result", type=Path, metavar="RESULT", help="a result folder of facestage fit"
    )
    reflectance.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="the folder to write"
    )
    reflectance.add_argument(
        "--directions",
        type=int,
        default=DIRECTIONS,
        metavar="N",
        help=f"all around the face, an even number (default {DIRECTIONS})",
    )
    reflectance.add_argument(
        "--spp",
        type=int,
        default=SAMPLES,
        metavar="N",
        help=f"shadow samples per light and sub-pixel (default {SAMPLES})",
    )
    reflectance.add_argument(
        "--json", action="store_true", help="tell of the progress in JSON on a terminal, too"
    )
    reflectance.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the field, telling of the progress on standard output."""
    from facestage.cli.terminal import listener
    from facestage.fit.result.reflectance import make_field

    with listener(options.json) as emit:
        make_field(options.result, options.out, options.directions, options.spp, emit)
    return EXIT_DONE
