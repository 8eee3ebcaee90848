"""Commands that the tools run: without input, their output and errors together."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping

from setup_error import SetupError


def run(
    command: list[str], env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command; ``env``: with these variables alone."""
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env=env,
    )


def require(
    command: list[str], env: Mapping[str, str] | None = None, lines: int | None = None
) -> None:
    """Run a command; raise SetupError with its last ``lines``, or all of them, where it fails."""
    done = run(command, env)
    if done.returncode:
        said = done.stdout.splitlines()
        last = "\n".join(said if lines is None else said[-lines:])
        raise SetupError(f"this command failed: {' '.join(command)}\n{last}")
