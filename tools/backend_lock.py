"""What the backend alone needs of requirements/: the lists that the extension carries, from which
Blender installs it.
"""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from setup_error import SetupError

PROJECT = Path(__file__).resolve().parent.parent
REQUIREMENTS = PROJECT / "requirements"


def write_backend_locks(target: Path) -> None:
    """Write the lists, one for each Python, into the folder ``target``."""
    names = backend_packages()
    target.mkdir(parents=True, exist_ok=True)
    for source in sorted(REQUIREMENTS.glob("python*.txt")):
        lock = source.read_text(encoding="utf-8")
        text = "".join(locked(lock, name, source.name) for name in names)
        (target / source.name).write_text(text, encoding="utf-8")


def backend_packages() -> list[str]:
    """What the backend depends on, and what that depends on, by the installed packages' words."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: set[str] = set()
    ahead = [Requirement(text) for text in project["dependencies"]]
    while ahead:
        requirement = ahead.pop()
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        ahead += [Requirement(text) for text in importlib.metadata.requires(name) or ()]
    return sorted(found)


def locked(lock: str, name: str, file: str) -> str:
    """The lines of a requirements file that pin ``name``, with its digests."""
    found = re.search(rf"^{re.escape(name)}==(?:.*\\\n)*.*$", lock, re.MULTILINE)
    if found is None or "--hash=sha256:" not in found[0]:
        raise SetupError(
            f"{file} does not pin {name} with its digests; requirements/README.md says how to."
        )
    return f"{found[0]}\n"
