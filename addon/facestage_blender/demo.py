"""Fits the demo's two photos (`make demo`); the command itself is :mod:`.headless.demo`.

python -P -m facestage_blender.demo [--out out/demo]
"""

from .headless.command import leave
from .headless.demo import main

if __name__ == "__main__":
    leave(main())
