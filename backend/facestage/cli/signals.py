"""Ctrl+C and SIGTERM: both ask for the same, also while libraries are imported."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType
from typing import Any

ASK_AGAIN_SECONDS = 0.05
CAN_ASK_AGAIN = hasattr(signal, "setitimer")


class Cancellation:
    """While entered, a signal raises KeyboardInterrupt where the program is, once that is safe."""

    def __init__(self, until_the_end: bool = False) -> None:
        self.asked = False
        self._over = False
        self._until_the_end = until_the_end
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Cancellation:
        if threading.current_thread() is threading.main_thread():
            # What the program was told to ignore, as by nohup, stays ignored.
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) != signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._answer)
        if self._until_the_end:
            sys.unraisablehook = self._unraisable
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
        if not self._until_the_end:
            for number, handler in self._before.items():
                signal.signal(number, handler)

    def close(self) -> None:
        """Answer no more signals: what is left to do is short, and must not be cut off."""
        self._over = True
        if CAN_ASK_AGAIN:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _unraisable(self, lost: sys.UnraisableHookArgs) -> None:
        """What was raised where Python cannot raise, as in a destructor."""
        if self._over:
            # All is said; objects that cannot close their file on a full disk would say it again,
            # in eight lines.
            return
        if CAN_ASK_AGAIN and self.asked and lost.exc_type is KeyboardInterrupt:
            self._ask_again()
            return
        sys.__unraisablehook__(lost)

    def _ask_again(self) -> None:
        """Have the same signal answered a moment later."""
        if signal.SIGALRM not in self._before:
            self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._answer)
        signal.setitimer(signal.ITIMER_REAL, ASK_AGAIN_SECONDS)

    def _answer(self, _number: int, frame: FrameType | None) -> None:
        if self._over:
            return
        self.asked = True
        if CAN_ASK_AGAIN:
            # A library may swallow the exception, or turn it into one of its own; one that is being
            # imported may abort. What is being put in order because of it must not be cut off.
            self._ask_again()
            if in_foreign_import(frame) or underway():
                return
        raise KeyboardInterrupt


def underway() -> bool:
    """Whether a KeyboardInterrupt is on its way out, and what runs now is there because of it."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def in_foreign_import(frame: FrameType | None) -> bool:
    """Whether ``frame`` belongs to the import of a module that is not Facestage's own."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] == "facestage":
            return False
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
