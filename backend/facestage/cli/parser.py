"""The parser of every command."""

from __future__ import annotations

import argparse

from facestage import __version__
from facestage.cli import (
    batch,
    bench,
    detect,
    doctor,
    fit,
    model,
    reflectance,
    render,
    stress,
    track,
)

EXAMPLES = """\
facestage doctor says what works on this machine.
Exit codes: 0 done, 2 bad input or a full disk, 3 cancelled, 4 no renderer works here,
5 some photos of a batch have no result.

examples:
  facestage fit photo.jpg --out result
  facestage fit left.jpg front.jpg right.jpg --same-person --out me
  facestage batch photos.csv --out fitted
  facestage track take.mp4 --out take
  facestage render result --out smile.png --weights smile.json
"""
COMMANDS = (fit, batch, track, detect, render, reflectance, model, bench, stress, doctor)


def build_parser() -> argparse.ArgumentParser:
    """The parser of every command; ``--help`` of each shows an example."""
    parser = argparse.ArgumentParser(
        prog="facestage",
        description="From a photograph of a face to a face that can be edited and relit.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"facestage {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add_command(commands)
    return parser
