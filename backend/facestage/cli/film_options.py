"""What may be said of a film, beside what is said of photos, too."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from facestage.contract.quality import GOOD, parse_budget

if TYPE_CHECKING:
    from facestage.fit.sequence.request import Request


def add_film_options(command: Any) -> None:
    """Add them to a command."""
    command.add_argument(
        "--rate", type=float, metavar="FPS", help="frames a second of a folder (default 24)"
    )
    command.add_argument(
        "--landmarks-only",
        action="store_true",
        help="follow landmarks alone once the keyframes are fitted: many times as fast, less exact",
    )
    command.add_argument(
        "--dynamic-skin",
        action="store_true",
        help="also find how much more or less blood the skin shows in each frame: a blush, a pale "
        "forehead; and wrinkles that come with an expression, of faces of 250 pixels; left out "
        "where they are not clearly seen (0.3 s a frame, and 2 s of 32 frames)",
    )
    command.add_argument(
        "--vertices",
        action="store_true",
        help="also write vertices.npy: (frames, n, 3) float32, metres, camera frame, model order",
    )


def read_request(options: argparse.Namespace) -> Request:
    """What is asked of ``options.film``. Raises InputError."""
    from facestage.contract.camera import Camera
    from facestage.fit.sequence.request import Request

    seconds, quality = parse_budget(options.budget or GOOD)
    return Request(
        film=options.film,
        rate=options.rate,
        model=options.model or "default",
        camera=Camera.read(options.camera) if options.camera else None,
        focal_px=options.focal_px,
        freeze=tuple(options.freeze),
        budget_seconds=seconds,
        quality=quality,
        landmarks_only=options.landmarks_only,
        dynamic_skin=options.dynamic_skin,
        truth=options.truth,
        with_vertices=options.vertices,
        face=options.face,
        seed=options.seed or 0,
        device=options.device or "auto",
    )
