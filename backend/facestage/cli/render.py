"""``facestage render``: a fitted face, relit or with another expression."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from facestage.contract.errors import EXIT_DONE, InputError


def add_command(commands: Any) -> None:
    """Add ``render`` to the commands."""
    render = commands.add_parser(
        "render",
        help="render a fitted face, relit or with another expression",
        description="Other lights come from the result's relight cache (relight.npz), in "
        "milliseconds; the first "
        "picture under other lights makes it when the fit has not.",
        epilog="Example: facestage render result --out relit.png --lights lights.json "
        "--weights smile.json",
    )
    render.add_argument(
        "result", type=Path, metavar="RESULT", help="a result folder of facestage fit"
    )
    render.add_argument(
        "--out", type=Path, metavar="FILE", help="picture to write: .exr (linear) or .png (sRGB)"
    )
    render.add_argument(
        "--lights",
        type=Path,
        metavar="FILE",
        help='{"radiance": [[r, g, b], ...]}, one row per light of the stage',
    )
    render.add_argument(
        "--weights",
        type=Path,
        metavar="FILE",
        help='{"expression": {name: weight}, "identity": {name: weight}}',
    )
    render.add_argument(
        "--spp",
        type=int,
        metavar="N",
        help="at least so many shadow samples per light (default: the cache's, else 16)",
    )
    render.add_argument(
        "--cache",
        action="store_true",
        help="make the relight cache anew, with or without a picture (what the add-on asks)",
    )
    render.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the picture, the cache, or both."""
    from facestage.fit.result.relight import make_cache, render_result

    if options.out is None and not options.cache:
        raise InputError(
            "facestage render has nothing to write; give --out FILE, or --cache for the "
            "relight cache."
        )
    lights = _read(options.lights, "light file")
    weights = _read(options.weights, "weight file")
    if options.cache:
        make_cache(options.result, options.spp)
    if options.out is not None:
        render_result(options.result, options.out, lights, weights, options.spp)
    return EXIT_DONE


def _read(path: Path | None, what: str) -> dict[str, Any] | None:
    from facestage.contract.files.storage import read_json

    return read_json(path, what) if path is not None else None
