"""How a command without a window ends: with its exit code, and one sentence where it failed."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import NoReturn

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


def leave(code: int) -> NoReturn:
    """End this process with ``code``.

    Blender as a module of Python is not taken down before: with an add-on's classes alive, 4.2
    crashes there (and the process ends with another code), and 4.5 never comes to an end.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or bpy.app.binary_path:
        sys.exit(code)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
