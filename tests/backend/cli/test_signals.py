"""Signals that a library loses, and those that come while things are put in order."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from facestage.cli.signals import ASK_AGAIN_SECONDS, CAN_ASK_AGAIN, Cancellation

pytestmark = pytest.mark.skipif(not CAN_ASK_AGAIN, reason="needs timers that send signals")
PATIENCE = 30.0


def wait(seconds: float) -> None:
    """In Python, where signals are answered."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(0.005)


def interrupted() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    wait(PATIENCE)


def test_a_signal_that_a_library_swallows_is_answered_again():
    swallowed = []

    def goes_on() -> None:
        try:
            interrupted()
        except BaseException:  # noqa: BLE001 - as a library does
            swallowed.append(True)
        wait(PATIENCE)

    with pytest.raises(KeyboardInterrupt), Cancellation():
        goes_on()
    assert swallowed


@pytest.mark.parametrize("again", [False, True])
def test_what_is_put_in_order_is_not_cut_off(tmp_path: Path, again: bool):
    """Neither by the same signal nor by another one, also while another error is handled."""
    in_order = []

    def tidy() -> None:
        try:
            (tmp_path / "nothing").unlink()
        except FileNotFoundError:
            if again:
                os.kill(os.getpid(), signal.SIGTERM)
            wait(3 * ASK_AGAIN_SECONDS)
        in_order.append(True)

    def tidies_up() -> None:
        try:
            interrupted()
        finally:
            tidy()

    with pytest.raises(KeyboardInterrupt), Cancellation():
        tidies_up()
    assert in_order


def test_nothing_is_asked_once_it_is_over():
    with pytest.raises(KeyboardInterrupt), Cancellation():
        interrupted()
    wait(3 * ASK_AGAIN_SECONDS)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
