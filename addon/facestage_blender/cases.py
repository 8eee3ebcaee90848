"""Makes photographs with known truth; the command itself is :mod:`.headless.cases`.

python -P -m facestage_blender.cases --out DIR [--count 12] [--model default|ict:PATH|npz:FILE]
python -P -m facestage_blender.cases --out DIR --person SEED [--photos 4] [--model ...]
"""

from .headless.cases import main
from .headless.command import leave

if __name__ == "__main__":
    leave(main())
