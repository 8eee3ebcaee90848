"""``facestage stress``: stiff and extreme cases."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def add_command(commands: Any) -> None:
    """Add ``stress`` to the commands."""
    stress = commands.add_parser(
        "stress",
        help="run stiff and extreme cases through the fit, and say what came of each",
        description="Fit small synthetic photos with known truth under stiff and extreme "
        "conditions, each in a process "
        "of its own: grazing light, NaN pixels, wrong landmarks, a stage 1000 km from its "
        "origin, ... A case may "
        "converge, stop with advice, or refuse in a sentence. The exit code is 1 when one is "
        "NaN, hangs, crashes, or "
        "claims to have converged beyond the bounds that the case states.",
        epilog="Example: facestage stress --out stress, or facestage stress --case "
        "grazing-light yaw-90. "
        "All cases take about a quarter of an hour on two cores.",
    )
    stress.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write the table there as stress.html, .txt and .json, and keep the files of "
        "cases at fault",
    )
    stress.add_argument(
        "--case",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="only these cases (default: all)",
    )
    stress.add_argument(
        "--list", action="store_true", help="print the names of the cases and what each stresses"
    )
    stress.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the cases; 1 when one is at fault."""
    from facestage.stress.run import list_cases, run_stress

    return (
        list_cases(sys.stdout)
        if options.list
        else run_stress(options.case, options.out, sys.stdout)
    )
