"""``facestage model``: what a face model holds."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from facestage.cli.common import MODELS
from facestage.contract.errors import EXIT_DONE, InputError


def add_command(commands: Any) -> None:
    """Add ``model`` to the commands."""
    model = commands.add_parser(
        "model",
        help="say what a face model holds and under what licence, and write it in Facestage's "
        "own form",
        description="Print a face model's name, licence, source and sizes as one line of "
        "JSON; with --out also write "
        "it in Facestage's own form (what the add-on builds rigs from). docs/face-models.md "
        "says how to get each.",
        epilog="Example: facestage model flame:generic_model.pkl --out flame.npz",
    )
    model.add_argument("model", metavar="MODEL", help=MODELS)
    model.add_argument("--out", type=Path, metavar="FILE", help=".npz to write")
    model.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print what the model holds; write it where asked."""
    from facestage.models.registry import load_model

    if options.out is not None and options.out.suffix != ".npz":
        raise InputError(
            f"The output '{options.out}' does not end in .npz; a face model is written as one "
            ".npz file."
        )
    model = load_model(options.model)
    if options.out is not None:
        model.save(options.out)
    summary = {
        "name": model.name,
        "license": model.license,
        "source": model.source,
        "vertices": len(model.vertices),
        "identity": len(model.identity_names),
        "expression": len(model.expression_names),
        "albedo": len(model.albedo_basis),
        "landmarks": sorted(model.landmarks),
    }
    print(json.dumps(summary))
    return EXIT_DONE
