"""What may be said of a photo: the options of every command that fits photos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from facestage.cli.common import MODELS, add_finding
from facestage.contract.quality import GOOD, QUALITIES, describe


def add_photo_options(command: Any) -> None:
    """Add them to a command."""
    command.add_argument("--model", metavar="MODEL", help=f"face model: {MODELS}")
    command.add_argument(
        "--landmarks",
        action="append",
        type=Path,
        metavar="FILE",
        help='{"scheme": "ibug68", "points": [[x, y], ...], "visible": [...]}; without it a '
        "face is found in the photo",
    )
    add_finding(command)
    camera = command.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera",
        action="append",
        type=Path,
        metavar="FILE",
        help='{"width":, "height":, "focal_px":, "principal_px": [cx, cy]}',
    )
    camera.add_argument(
        "--focal-px",
        action="append",
        type=float,
        metavar="F",
        help="focal length in pixels; fitted when neither is given",
    )
    command.add_argument(
        "--lights", type=int, metavar="N", help="area lights of the virtual stage (default 20)"
    )
    command.add_argument(
        "--environment",
        metavar="FILE.exr[@DEGREES]",
        help="the photo's surroundings, where they are known, instead of fitted lights: a "
        "latitude-longitude map of linear radiance (OpenEXR, any exposure) with the zenith above, "
        "turned so many degrees about the vertical",
    )
    command.add_argument(
        "--surround",
        choices=("auto", "on", "off"),
        help="lights behind the face beside those of the stage: where the photo needs them "
        "(auto, default), always or never",
    )
    command.add_argument(
        "--white-balance",
        action="append",
        metavar="X,Y|R,G,B",
        help="what is grey or white in the photo, in the light that falls on the face: its pixel, "
        "from the upper left corner, or the linear color that it shows. Without it, the color of "
        "the light, and with it the skin's, is a guess",
    )
    command.add_argument(
        "--skin-tone",
        metavar="TYPE|DEGREES",
        help="how light the skin is, which a photo alone hardly tells: very-light, light, "
        "intermediate, tan, brown or dark, or its individual typology angle (70 lightest, -80 "
        "darkest)",
    )
    command.add_argument(
        "--texture-size",
        type=int,
        choices=(512, 1024, 2048, 4096),
        help="the most texels along the textures (default 2048, of a draft 1024); as many as the "
        "photo fills are made: 4096 takes a face of 700 pixels and more, several times the time "
        "and 3.3 GB",
    )
    command.add_argument(
        "--light-color",
        choices=("multi", "uniform"),
        help="a color for each light (default), or one for all",
    )
    command.add_argument(
        "--freeze",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME",
        help="do not fit: identity, expression, pose, albedo, ...",
    )
    command.add_argument(
        "--budget",
        metavar="SECONDS|NAME",
        help="seconds from the first step on, pictures included; or a quality: "
        + "; ".join(f"{name} ({describe(name)})" for name in QUALITIES)
        + f" (default: {GOOD}, as long as it takes)",
    )
    command.add_argument(
        "--seed", type=int, metavar="N", help="seed of the light samples (default 0)"
    )
    command.add_argument(
        "--device", choices=("auto", "cpu", "cuda"), help="where to trace rays (default auto)"
    )
    command.add_argument(
        "--truth",
        action="append",
        type=Path,
        metavar="FILE",
        help="what is known of the shape (.npz): adds errors to the result, changes nothing; the "
        "face model's own vertices in metres, or a scan: vertices (millimetres) and triangles, "
        "both in the camera's frame (x right, y up, looking along -z)",
    )
    command.add_argument(
        "--face-region",
        action="append",
        type=Path,
        metavar="FILE.npy",
        help="which vertices of a scan given as --truth are its face: their numbers, or true and "
        "false for each (default: the scan's own array 'face', or face_region.npy beside it); "
        "one does for several photos",
    )
    command.add_argument(
        "--plan",
        choices=("lean", "full"),
        help="lean (default) leaves out what the scene does not need; full works on "
        "everything, to check that the "
        "answer is the same",
    )
