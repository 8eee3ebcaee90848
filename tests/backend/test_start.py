"""What a start loads, in fresh processes: what takes seconds to load waits until it is needed."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = {"cv2", "drjit", "matplotlib", "mitsuba", "scipy", "skimage"}
BLENDER = {"bpy", "mathutils"}


@pytest.mark.parametrize(
    "module",
    [
        "facestage",
        "facestage.cli",
        "facestage.contract",
        "facestage.doctor",
        "facestage_blender",
        "facestage_blender.batch",
        "facestage_blender.cases",
        "facestage_blender.demo",
    ],
)
def test_starting_is_cheap(module: str) -> None:
    assert not packages_loaded_by(module) & (HEAVY | BLENDER)


def packages_loaded_by(module: str) -> set[str]:
    """Top-level packages in a fresh process after importing ``module``."""
    code = f"import json, sys, {module}; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in json.loads(done.stdout)}
