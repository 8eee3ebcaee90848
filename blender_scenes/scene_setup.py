"""What the scripts of this folder share: finding the project's packages, and the face model."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
for package, folder in (("facestage_blender", "addon"), ("facestage", "backend")):
    # inside Blender, which does not see the project's environment
    if importlib.util.find_spec(package) is None:
        sys.path.append(str(ROOT / folder))

# After the path is set.
from facestage.contract.errors import FacestageError  # noqa: E402
from facestage.contract.face_model import FaceModel  # noqa: E402
from facestage_blender.backend.commands import find_backend  # noqa: E402
from facestage_blender.headless import pipeline  # noqa: E402
from facestage_blender.headless.batch import own_arguments  # noqa: E402


def options_of(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """The options meant for the script, inside Blender or out."""
    return parser.parse_args(own_arguments())


def run(main: Callable[[], None]) -> None:
    """Run a script's main function; a user's error becomes one sentence and the contract's exit
    code.
    """
    try:
        main()
    except FacestageError as error:
        print(f"facestage: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


def face_model(spec: str = "default") -> FaceModel:
    """A face model, exported by the backend."""
    return pipeline.face_model(spec, find_backend(), lambda _event: None)
