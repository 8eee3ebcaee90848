"""Fits a photo without a window; the command itself is :mod:`.headless.batch`.

python -P -m facestage_blender.batch --image PHOTO --out DIR [options]
blender -b --factory-startup --python addon/facestage_blender/batch.py -- --image PHOTO --out DIR
"""

import importlib.util
import sys
from pathlib import Path

if not __package__:
    # Blender runs this file by its path: make its package, and the contract beside it, importable.
    ROOT = Path(__file__).resolve().parent.parent
    sys.path.insert(0, str(ROOT))
    if importlib.util.find_spec("facestage") is None:
        sys.path.append(str(ROOT.parent / "backend"))

from facestage_blender.headless.batch import main
from facestage_blender.headless.command import leave

if __name__ == "__main__":
    leave(main())
