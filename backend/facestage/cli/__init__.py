"""The command line: parse, call one function, turn errors into one sentence and an exit code.

Importing this package imports next to nothing, so that a signal while the rest is imported is
already answered.
"""

from __future__ import annotations

import sys

CANCELLED = "facestage: cancelled; run it again to start over."
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0 done, 2 bad input, 3 cancelled, 4 no backend,
    5 some of a batch failed.

    Without ``arguments`` it is the process's only task: then signals are answered until the process
    ends.
    """
    from facestage.cli.signals import Cancellation

    with Cancellation(until_the_end=arguments is None) as cancellation:
        try:
            from facestage.cli.run import run_command
        except KeyboardInterrupt:
            cancellation.close()
            print(CANCELLED, file=sys.stderr)
            return 3
        return run_command(arguments, cancellation)
