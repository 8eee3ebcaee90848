"""One command from its arguments to its exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from facestage.cli import streams
from facestage.cli.signals import Cancellation
from facestage.contract.errors import CancelledError, FacestageError, InputError
from facestage.contract.files.machine import machine_trouble
from facestage.system.child import trusted_path
from facestage.system.cores import use_algebra_threads
from facestage.system.folders import shelter_caches
from facestage.system.freed_memory import keep_freed_memory

EXIT_BAD_INPUT, EXIT_CANCELLED = InputError.exit_code, CancelledError.exit_code


def run_command(arguments: Sequence[str] | None, cancellation: Cancellation) -> int:
    """Parse ``arguments`` (the process's own when None), run the command, and return its exit
    code.
    """
    options: argparse.Namespace | None = None
    try:
        if arguments is None:
            _prepare_process()
        from facestage.cli.parser import build_parser

        options = build_parser().parse_args(arguments)
        _check_paths(options)
        code = int(options.run(options))
        streams.flush_output()
    except BaseException as error:  # noqa: BLE001 - raised again below, unless there is a sentence for it
        # No signal may cut off what is said of the first.
        cancellation.close()
        if cancellation.asked or isinstance(error, KeyboardInterrupt):
            return _cancelled(options)
        return _failed(error)
    return code


def _check_paths(options: argparse.Namespace) -> None:
    """Raise InputError for a path that no machine has, whichever option it belongs to."""
    from facestage.contract.files.paths import user_path

    for name, value in vars(options).items():
        for path in value if isinstance(value, list) else [value]:
            if isinstance(path, Path):
                user_path(path, f"path given as {name.replace('_', ' ')}")


def _prepare_process() -> None:
    """What only a process that runs nothing else may change."""
    streams.open_missing()
    # Started with -m, Python would look for every module in the current folder first.
    sys.path[:] = trusted_path()
    shelter_caches()
    use_algebra_threads()
    keep_freed_memory()


def _cancelled(options: argparse.Namespace | None) -> int:
    """Say what is left of a command that was stopped.

    A library may have turned the signal into another exception.
    """
    left = getattr(options, "cancelled", None)
    streams.say("cancelled; run it again to start over." if left is None else left(options))
    _flush_or_silence()
    return EXIT_CANCELLED


def _failed(error: BaseException) -> int:
    """Say why a command ended with ``error``, and return the exit code; a fault of the program's
    own is raised.
    """
    if isinstance(error, BrokenPipeError):
        # Whoever listened is gone.
        streams.silence(sys.stdout)
        return EXIT_CANCELLED
    if isinstance(error, SystemExit):
        try:
            streams.flush_output()
        except OSError as full:
            return _failed(full)
        raise error
    if isinstance(error, FacestageError):
        streams.say(str(error))
        _flush_or_silence()
        return error.exit_code
    sentence = machine_trouble(error)
    if sentence is None:
        raise error
    streams.say(sentence)
    _flush_or_silence()
    return EXIT_BAD_INPUT


def _flush_or_silence() -> None:
    try:
        streams.flush_output()
    except OSError:
        streams.silence(sys.stdout)
