"""A real Blender with its window, for `make test-window`: Debian trixie's in a folder of its own.

Debian 12's Blender is too old, and Blender as a Python module has no window. Wants root, because
it unpacks a whole Debian to change into.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from commands import require
from setup_error import SetupError
from setup_native import apt, apt_install, can_apt_install

SUITE, MIRROR = "trixie", "http://deb.debian.org/debian"
# The screen, the hands, and the eyes that read buttons' labels.
TOOLS = {
    "debootstrap": "debootstrap",
    "Xvfb": "xvfb",
    "xdotool": "xdotool",
    "import": "imagemagick",
    "tesseract": "tesseract-ocr",
}
# Blender's own download has numpy and venv in it; Debian's does without.
BLENDER = ("blender", "python3-numpy", "python3-venv", "libgl1-mesa-dri", "libglx-mesa0")
ENV = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "DEBIAN_FRONTEND": "noninteractive"}
LINES = 5  # of what a command said that are repeated where it fails
FINISHED = "facestage-window.stamp"


def main() -> int:
    """Set up into the folder given, or say why not; the tests skip then."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="a new one, or of a former run; takes 1.7 GB")
    folder = parser.parse_args().folder.expanduser().resolve()
    try:
        set_up(folder)
    except (SetupError, OSError) as error:
        print(f"make test-window: {error}", file=sys.stderr)
    return 0


def set_up(folder: Path) -> None:
    """Install the tools, and Blender into ``folder``, where they are not there already."""
    missing = [package for tool, package in TOOLS.items() if shutil.which(tool) is None]
    stamp = folder / FINISHED
    made_of = " ".join([SUITE, *BLENDER])
    whole = stamp.is_file() and stamp.read_text(encoding="utf-8") == made_of
    if whole and not missing:
        return
    if not can_apt_install():
        raise SetupError("only root on Debian or Ubuntu can set Blender's window up.")
    if missing:
        apt(["apt-get", "update"])
        apt_install(missing)
    if whole:
        return
    print(f"Installing Blender into {folder} (1.7 GB; three minutes) ...", flush=True)
    former = stamp.is_file()
    if not former and folder.exists() and any(folder.iterdir()):
        raise SetupError(f"{folder} holds something else; give a new folder.")
    root = folder if former else folder.with_name(folder.name + ".part")
    if not former:
        shutil.rmtree(root, ignore_errors=True)
        root.parent.mkdir(parents=True, exist_ok=True)
        require(["debootstrap", "--variant=minbase", SUITE, str(root), MIRROR], ENV, LINES)
    # A namespace of its own, so that nothing stays mounted.
    install = "mount -t proc proc {0}/proc && chroot {0} apt-get install --yes {1}".format(
        '"$1"', " ".join(["--no-install-recommends", *BLENDER])
    )
    require(["unshare", "--mount", "sh", "-c", install, "sh", str(root)], ENV, LINES)
    root.replace(folder)
    stamp.write_text(made_of, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
