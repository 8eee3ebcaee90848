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
        description="By its own lights, other ones of the same stage, or a map of the "
        "surroundings. Other lights come from the result's relight cache (relight.npz), in "
        "milliseconds; the first "
        "picture under other lights makes it when the fit has not.",
        epilog="Example: facestage render result --out relit.png --lights lights.json "
        "--weights smile.json, or facestage render result --out sky.exr --environment sky.exr@40",
    )
    render.add_argument(
        "result",
        type=Path,
        metavar="RESULT",
        help="a result folder of facestage fit; or with --environment, of facestage reflectance",
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
        "--environment",
        metavar="FILE.exr[@DEGREES]",
        help="the light of these surroundings instead: a latitude-longitude map of linear radiance "
        "(OpenEXR) with the zenith above, turned so many degrees about the vertical",
    )
    render.add_argument(
        "--strength", type=float, metavar="F", help="factor on the map's radiance (default 1)"
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
    if options.environment is not None:
        return _under_map(options)
    if options.strength is not None:
        raise InputError("--strength is a factor on a map's radiance; give --environment FILE.exr.")
    lights = _read(options.lights, "light file")
    weights = _read(options.weights, "weight file")
    if options.cache:
        make_cache(options.result, options.spp)
    if options.out is not None:
        render_result(options.result, options.out, lights, weights, options.spp)
    return EXIT_DONE


def _under_map(options: argparse.Namespace) -> int:
    """Write the picture under a map of the surroundings."""
    from facestage.cli.environment import read_environment
    from facestage.contract.reflectance import is_field
    from facestage.fit.result.surroundings import render_field, render_under_map

    if options.out is None or options.lights is not None or options.cache:
        raise InputError(
            "--environment is light of its own; give --out FILE with it, and neither --lights nor "
            "--cache."
        )
    strength = 1.0 if options.strength is None else options.strength
    if not 0 < strength <= 1e6:
        raise InputError(f"--strength is {strength:g}; expected more than 0, at most 1e6.")
    field = is_field(options.result)
    if field and (options.weights is not None or options.spp is not None):
        raise InputError(
            "A reflectance field is of one face in its own samples; leave out --weights and --spp, "
            "or render the result."
        )
    picture, degrees = read_environment(options.environment)
    if field:
        render_field(options.result, options.out, strength * picture, degrees)
    else:
        weights = _read(options.weights, "weight file")
        render_under_map(
            options.result, options.out, strength * picture, degrees, weights, options.spp
        )
    return EXIT_DONE


def _read(path: Path | None, what: str) -> dict[str, Any] | None:
    from facestage.contract.files.storage import read_json

    return read_json(path, what) if path is not None else None
