"""How a command without a window ends: with its exit code, and one sentence where it failed."""

from __future__ import annotations

import sys
from collections.abc import Callable

from facestage.contract.errors import CancelledError, FacestageError, InputError
from facestage.contract.files.machine import machine_trouble


def exit_code(action: Callable[[], None], cancelled: str) -> int:
    """Run ``action``; 0 when it did what was asked, else the code of its error, which is printed.

    ``cancelled``: the sentence for a user who interrupts it.
    """
    try:
        action()
    except FacestageError as error:
        code, sentence = error.exit_code, str(error)
    except KeyboardInterrupt:
        code, sentence = CancelledError.exit_code, cancelled
    except (OSError, MemoryError) as error:
        code, sentence = InputError.exit_code, machine_trouble(error) or str(error)
    else:
        return 0
    print(f"facestage: {sentence}", file=sys.stderr)
    return code
