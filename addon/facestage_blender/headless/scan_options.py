"""The options of the ``--scan`` family of the cases. No bpy."""

from __future__ import annotations

import argparse
from pathlib import Path

from facestage.contract.errors import InputError

SCAN_SIZE = 512  # pixels along a side, unless --size says otherwise
UNITS = ("mm", "cm", "m")
AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
YAWS, PITCHES = (15.0, -25.0, 5.0), (0.0,)  # degrees, of each photo
TURN_MAX = 60.0  # faces that are turned further are not found
LIGHTS = ("interior@40", "courtyard@120", "sunset@200")
# What says who is photographed, and of which the scan is instead.
OTHERS = ("only", "person", "list")


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the family."""
    group = parser.add_argument_group(
        "photographs of a scan",
        "Instead of people of a face model: photographs of a scanned head, which a fit is judged "
        "by with facestage fit --truth scan.npz or facestage bench --case DIR. Each folder holds "
        "photo.png, photo.exr, camera.json and scan.npz (the scan where the camera saw it).",
    )
    group.add_argument(
        "--scan",
        type=Path,
        metavar="FILE.obj",
        help="the scan: triangles, quads or any polygons; UVs only where it has a picture",
    )
    group.add_argument(
        "--scan-color", type=Path, metavar="FILE", help="its albedo as a picture over its UVs"
    )
    group.add_argument(
        "--scan-normal", type=Path, metavar="FILE", help="its normals in tangent space"
    )
    group.add_argument(
        "--scan-units", choices=UNITS, default="mm", help="what a 1 in the file means (default mm)"
    )
    group.add_argument(
        "--scan-facing",
        choices=AXES,
        default="+Z",
        metavar="AXIS",
        help="the file's axis that the head looks along: +X, -X, +Y, ... (default +Z); write "
        "--scan-facing=-Y for a negative one",
    )
    group.add_argument(
        "--scan-up",
        choices=AXES,
        default="+Y",
        metavar="AXIS",
        help="the file's axis that its crown points to (default +Y)",
    )
    group.add_argument(
        "--face-region",
        type=Path,
        metavar="FILE.npy",
        help="numbers of the scan's vertices that are its face, or true and false for each "
        "(default: what a camera in front of it sees, at less than 80 degrees, within the hull of "
        "the landmarks that are found there)",
    )
    for name, words, usual in (
        ("yaw", "to the picture's right", YAWS),
        ("pitch", "downwards", PITCHES),
    ):
        group.add_argument(
            f"--scan-{name}",
            nargs="+",
            type=float,
            default=usual,
            metavar="DEGREES",
            help=f"how far the head is turned {words} in each photo (default "
            f"{' '.join(f'{angle:g}' for angle in usual)})",
        )
    group.add_argument(
        "--scan-light",
        nargs="+",
        metavar="NAME[@DEGREES]",
        help="the surroundings of each photo, turned about the vertical: one of Blender's own "
        "(city, courtyard, forest, interior, night, studio, sunrise, sunset) or an .exr or .hdr "
        f"file (default {' '.join(LIGHTS)}); of yaws, pitches and lights the shorter lists "
        "repeat",
    )


def check_alone(options: argparse.Namespace) -> None:
    """Raise InputError where people of a face model are asked for beside the scan."""
    given = [name for name in OTHERS if getattr(options, name) not in (None, [], False)]
    if given:
        raise InputError(f"--scan photographs the scan alone; leave out --{given[0]}, or --scan.")
