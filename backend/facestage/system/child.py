"""How to start another Python that runs nothing from the folder the user happens to be in.

``python -c`` and ``python -m`` put the current folder first on ``sys.path``: a file ``numpy.py``
beside the user's photo would be run. ``-I`` leaves out that folder, every PYTHON* variable and the
user's own site-packages; what of those this process was found with is handed on by name, after the
child's own folders. What ``multiprocessing`` starts is kept as far from that folder.
"""

from __future__ import annotations

import contextlib
import os
import site
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType


def python_code(code: str, *arguments: str) -> list[str]:
    """The command line that runs ``code`` in an isolated Python, with ``arguments`` in
    ``sys.argv[1:]``.
    """
    known = (
        f"import sys; sys.path.extend(folder for folder in {trusted_path()!r} if folder "
        "not in sys.path)"
    )
    return [sys.executable, "-I", "-c", f"{known}\n{code}", *arguments]


def python_module(module: str, *arguments: str) -> list[str]:
    """The command line that runs ``module`` as ``python -m`` does, in an isolated Python."""
    code = f"import runpy; runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    return python_code(code, *arguments)


@contextlib.contextmanager
def apart(**variables: str) -> Iterator[None]:
    """Processes that ``multiprocessing`` spawns meanwhile begin isolated, with these environment
    ``variables``, and without this program's main file: run there again, a script that tracks a
    film would track it there too.
    """
    # Python has no option for any of this: what is spawned inherits it from this process.
    before = dict(os.environ), sys.path, sys.modules["__main__"]
    for name in before[0]:
        if name.startswith("PYTHON"):
            del os.environ[name]
    os.environ.update(variables, PYTHONSAFEPATH="1", PYTHONNOUSERSITE="1")
    sys.path, sys.modules["__main__"] = trusted_path(), ModuleType("__main__")
    try:
        yield
    finally:
        environment, sys.path, sys.modules["__main__"] = before
        for name in set(os.environ) - set(environment):
            del os.environ[name]
        os.environ.update(environment)


def trusted_path() -> list[str]:
    """``sys.path`` without the current folder and what PYTHONPATH names relative to it; Facestage's
    own comes last.

    A PYTHONPATH that begins or ends with a colon names the current folder too, which few people
    know.
    """
    current = _current_folder()
    doubtful = {""}
    if current is not None:
        entries = [Path(entry) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep)]
        relative = [
            os.path.normpath(current / entry) for entry in entries if not entry.is_absolute()
        ]
        doubtful |= {str(current), *relative}
    with contextlib.suppress(RuntimeError):
        # A user without a home has no site-packages of his own.
        doubtful -= {site.getusersitepackages()} if site.ENABLE_USER_SITE else set()
    folders = [folder for folder in sys.path if folder not in doubtful]
    own = str(Path(__file__).resolve().parents[2])
    return folders if own in folders else [*folders, own]


def _current_folder() -> Path | None:
    """The current folder, or None where it was removed."""
    try:
        return Path.cwd()
    except OSError:
        return None
