"""`python -m facestage.cli`."""

import sys

from facestage.cli import main

if __name__ == "__main__":
    sys.exit(main())
