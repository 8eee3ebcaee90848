"""Makes photographs with known truth; the command itself is :mod:`.headless.cases`.

python -P -m facestage_blender.cases --out DIR [options]
"""

import sys

from .headless.cases import main

if __name__ == "__main__":
    sys.exit(main())
