"""Other arguments on a command line: options that go, come, repeat, and values that are none."""

from __future__ import annotations

import json

from fuzz.choice import Choose

OPTIONS = [
    "--out",
    "--model",
    "--landmarks",
    "--camera",
    "--focal-px",
    "--lights",
    "--light-color",
    "--freeze",
    "--budget",
    "--seed",
    "--device",
    "--truth",
    "--plan",
    "--resume",
    "--face",
    "--landmark-model",
    "--picture",
    "--all",
    "--weights",
    "--spp",
    "--cache",
    "--case",
    "--quick",
    "--alone",
    "--list",
    "--job",
    "--same-person",
    "--version",
    "--help",
    "--",
    "-x",
]
# Nothing here names a place outside the input's own folder that could be written to.
VALUES = (
    "",
    " ",
    "0",
    "-1",
    "1",
    "2",
    "1e9",
    "nan",
    "inf",
    "-inf",
    "1e-400",
    "9" * 5000,
    "9" * 400,
    "0x10",
    "1_000",
    "five",
    "default",
    "default:x",
    "npz:",
    "npz:face.npz",
    "npz:~nosuchuser/face.npz",
    "rig:rig.npz",
    "rig:photo.png",
    "rig:.",
    "ict:.",
    "ict:photo.png",
    "flame:.",
    "flame:face.npz",
    "bfm:.",
    "bfm:photo.png",
    "gnm:.",
    "gnm:face.npz",
    "nope:x",
    ":",
    "npz:" + "a/" * 2500,
    "a" * 5000,
    "a" * 300 + ".npz",
    "~nosuchuser",
    "~nosuchuser/a.npz",
    "photo.png",
    "missing.png",
    ".",
    "..",
    "job",
    "result",
    "landmarks.json",
    "camera.json",
    "face.npz",
    "lights.json",
    "new.npz",
    "new.png",
    "new.exr",
    "new",
    "photo.png/new",
    "/proc/nope/new.npz",
    "a\nb",
    "a\u2028b",
    "a\x1b[31mb",
    "\ud800",
    "\udcff.png",
    "*",
    "cpu",
    "cuda",
    "lean",
    "draft",
    "uniform",
    "pose",
    "identity",
    "Traceback",
    "%s",
    "{}",
    "npz:a\nb",
    "npz:\udcff",
)


def mangle_arguments(choose: Choose, data: bytes) -> bytes:
    """A JSON list of arguments with one to three changes."""
    arguments = list(json.loads(data))
    for _ in range(choose.number(1, 3)):
        place = choose.number(0, len(arguments))
        kind = choose.number(0, 5)
        if kind == 0 and place < len(arguments):
            del arguments[place]
        elif kind <= 2 and place < len(arguments):
            arguments[place] = choose.one_of(VALUES)
        elif kind == 3:
            arguments[place:place] = [choose.one_of(OPTIONS)]
        elif kind == 4:
            arguments[place:place] = [choose.one_of(OPTIONS), choose.one_of(VALUES)]
        elif arguments:
            arguments.insert(place, choose.one_of(arguments))
    return json.dumps(arguments).encode()
