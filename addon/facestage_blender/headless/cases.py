"""Makes photographs with known truth: of one person of each kind, several of the same, or of a
scan.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Collection, Sequence
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.job import DEFAULT_MODEL

from ..synthetic.cases.recipe import BELOW as BELOW_RECIPES
from ..synthetic.cases.recipe import RECIPES, Recipe
from ..synthetic.cases.same_person import PHOTOS
from ..synthetic.cases.skies import skies
from ..synthetic.cases.tones import tones
from ..synthetic.cases.wrinkled import wrinkled
from .command import exit_code
from .scan_options import SCAN_SIZE, add_options, check_alone

SAMPLES, SIZE = 96, 256
SIZE_MIN, SIZE_MAX = 16, 4096
TONES, SKIES, BELOW, RELIEF = "tones", "skies", "below", "relief"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = argparse.ArgumentParser(
        prog="facestage_blender.cases",
        description="Make photographs with known truth.",
        epilog="Example: --model ict:PATH --out cases, or --scan head.obj --scan-units cm "
        "--scan-color color.jpg --out scans.",
    )
    result.add_argument("--out", type=Path, help="folder for the cases, one folder each")
    result.add_argument(
        "--count",
        type=int,
        default=len(RECIPES),
        help="how many; more than the recipes repeat them",
    )
    result.add_argument(
        "--only", nargs="*", default=[], metavar="NAME", help="only cases of these names"
    )
    result.add_argument("--model", default=DEFAULT_MODEL, help="default, ict:PATH or npz:FILE")
    result.add_argument(
        "--size",
        type=int,
        help=f"side of the photos in pixels (default {SIZE}, of a scan {SCAN_SIZE})",
    )
    result.add_argument("--samples", type=int, default=SAMPLES, help="samples per pixel")
    result.add_argument(
        "--seed", type=int, default=0, help="other people, poses and lamps of the same recipes"
    )
    result.add_argument(
        "--person",
        type=int,
        metavar="SEED",
        help="instead: several photos of the person of this seed",
    )
    result.add_argument(
        "--people",
        choices=(TONES, SKIES, BELOW, RELIEF),
        help="instead: tones, 36 people of six skin types under three lights; skies, "
        "eight people, each in one of the surroundings that Blender ships; below, four in whose "
        "skin light wanders; relief, two with grooves and bumps of known height, each under three "
        "lights",
    )
    result.add_argument(
        "--photos",
        type=int,
        default=4,
        metavar="N",
        help=f"how many of the person, 1 to {len(PHOTOS)} (default 4)",
    )
    result.add_argument(
        "--list",
        action="store_true",
        help="only say which cases there are, and what is hard in each",
    )
    add_options(result)
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the cases; returns the exit code."""
    options = parser().parse_args(arguments)
    return exit_code(lambda: run(options), "cancelled; the finished cases are kept.")


def run(options: argparse.Namespace) -> None:
    """Make the cases, or list them."""
    if options.size is None:
        options.size = SIZE if options.scan is None else SCAN_SIZE
    if options.scan is not None:
        check_alone(options)
        check_output(options)
        # Needs Blender, which a list of the recipes does not.
        from .scan_cases import make_scan_cases

        make_scan_cases(options)
        return
    chosen = _chosen(options)
    if options.list:
        for name, (recipe, _) in chosen.items():
            print(f"{name:<20} {recipe.hard}")
        return
    check_output(options)
    make(chosen, options)


def _chosen(options: argparse.Namespace) -> dict[str, tuple[Recipe, int | None]]:
    """The cases by name, with the seed of who it is where that is no matter of the case."""
    if options.people is not None:
        if options.person is not None:
            raise InputError("--people and --person are two orders; leave out one of them.")
        people: dict[str, tuple[Recipe, int | None]]
        if options.people == SKIES:
            people = {name: (recipe, None) for name, recipe in skies().items()}
        elif options.people == BELOW:
            people = {recipe.name: (recipe, None) for recipe in BELOW_RECIPES}
        elif options.people == RELIEF:
            people = dict(wrinkled())
        else:
            people = dict(tones())
        return {name: people[name] for name in named(people, options.only)}
    if options.person is not None:
        return {name: (each, options.person) for name, each in photos(options.photos).items()}
    return {name: (each, None) for name, each in choose(options.count, options.only).items()}


def check_output(options: argparse.Namespace) -> None:
    """Raise InputError for photos that cannot be made, or that there is no place for."""
    if options.out is None:
        raise InputError("No folder was given for the cases; add --out DIR.")
    if not SIZE_MIN <= options.size <= SIZE_MAX or options.samples < 1:
        raise InputError(
            f"Photos of {options.size} pixels with {options.samples} samples cannot be made; "
            f"--size goes from {SIZE_MIN} to {SIZE_MAX}, --samples from 1."
        )


def choose(count: int, only: Sequence[str]) -> dict[str, Recipe]:
    """The first ``count`` cases by name: each recipe once, then again as NAME_2, NAME_3, ... with
    other seeds.

    Raises InputError for a count below 1 and for a name in ``only`` that is not among them.
    """
    if count < 1:
        raise InputError(f"{count} cases were asked for; expected 1 or more.")
    cases = {}
    for index in range(count):
        turn, which = divmod(index, len(RECIPES))
        recipe = RECIPES[which]
        cases[f"{recipe.name}_{turn + 1}" if turn else recipe.name] = recipe
    return {name: cases[name] for name in named(cases, only)}


def named(cases: Collection[str], only: Collection[str]) -> list[str]:
    """Those of the ``cases`` whose names are in ``only``, or all.

    Raises InputError for a name in ``only`` that is not among them.
    """
    unknown = [name for name in only if name not in cases]
    if unknown:
        raise InputError(f"There is no case '{unknown[0]}'; --list says which there are.")
    return [name for name in cases if not only or name in only]


def photos(count: int) -> dict[str, Recipe]:
    """The first ``count`` photos of a person by name.

    Raises InputError for a count that there is not.
    """
    if not 1 <= count <= len(PHOTOS):
        raise InputError(f"{count} photos of a person were asked for; expected 1 to {len(PHOTOS)}.")
    return {recipe.name: recipe for recipe in PHOTOS[:count]}


def case_seed(name: str, seed: int) -> int:
    """The seed of a case, which does not depend on what other cases there are."""
    return zlib.crc32(f"{name}/{seed}".encode()) % 2**31  # as much as Cycles takes


def make(chosen: dict[str, tuple[Recipe, int | None]], options: argparse.Namespace) -> None:
    """Photograph every case into its own folder, each written whole."""
    from ..backend.commands import find_backend
    from . import pipeline

    model = pipeline.face_model(options.model, find_backend(), lambda _event: None)
    for name, (recipe, same) in chosen.items():
        started = time.monotonic()
        make_case(model, name, recipe, options, same)
        print(f"{name:<20} {time.monotonic() - started:5.1f} s", flush=True)


def make_case(
    model: FaceModel, name: str, recipe: Recipe, options: argparse.Namespace, same: int | None
) -> None:
    """Photograph one case into the folder NAME of ``--out``.

    ``same``: the seed of who it is; None: someone of the case's own.
    """
    from ..synthetic.cases.person import person_of
    from ..synthetic.photograph import render_person
    from . import pipeline

    folder = options.out.resolve() / name
    seed = case_seed(name if same is None else f"{same}/{name}", options.seed)
    scene = pipeline.empty_scene()
    person = person_of(model, recipe, seed, same)
    render_person(scene, model, person, folder, options.samples, seed, options.size)
