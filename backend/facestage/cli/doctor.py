"""``facestage doctor``: what works on this machine."""

from __future__ import annotations

import argparse
import sys
from typing import Any


def add_command(commands: Any) -> None:
    """Add ``doctor`` to the commands."""
    doctor = commands.add_parser(
        "doctor", help="say what works on this machine, and how to mend the rest"
    )
    doctor.set_defaults(run=run)


def run(_options: argparse.Namespace) -> int:
    """Write the report; 0 when a fit can run here, else 4."""
    from facestage.doctor import run_doctor

    return run_doctor(sys.stdout)
