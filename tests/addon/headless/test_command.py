"""How a command ends: its exit code, and one sentence."""

from __future__ import annotations

import errno
import os

import pytest

from facestage.contract.errors import BackendUnavailableError, InputError
from facestage_blender.headless.command import exit_code


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (InputError("The photo is gone; choose another."), 2, "The photo is gone; choose another."),
        (BackendUnavailableError("No backend."), 4, "No backend."),
        (KeyboardInterrupt(), 3, "stopped."),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "out"), 2, "Cannot write 'out'"),
        (MemoryError(), 2, "The memory is not enough"),
    ],
)
def test_an_error_is_a_code_and_a_sentence(
    error: BaseException, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    assert exit_code(fail, "stopped.") == code
    spoken = capsys.readouterr().err
    assert spoken.startswith(f"facestage: {said}") and spoken.count("\n") == 1


def test_what_is_done_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(lambda: None, "stopped.") == 0
    assert capsys.readouterr().err == ""


def test_a_fault_of_the_program_is_not_hidden() -> None:
    def fail() -> None:
        raise KeyError("x")

    with pytest.raises(KeyError):
        exit_code(fail, "stopped.")
