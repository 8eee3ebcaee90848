"""What a sequence is asked for."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.parameters import PARAMETERS
from facestage.contract.quality import BEST, DRAFT, GOOD

# Looks at the pictures of all frames, by quality.
PASSES = {DRAFT: 1, GOOD: 3, BEST: 7}
# Of a sequence, the head's pose is what is looked for.
NEVER_FROZEN = ("pose",)


@dataclass(frozen=True)
class Request:
    """A film, and how to follow the face in it."""

    film: Path
    rate: float | None = None  # of a folder, frames a second
    model: str = "default"
    camera: Camera | None = None
    focal_px: float | None = None
    freeze: tuple[str, ...] = ()
    budget_seconds: float | None = None
    quality: str = GOOD
    landmarks_only: bool = False
    truth: Path | None = None
    with_vertices: bool = False
    face: int | None = None
    seed: int = 0
    device: str = "auto"
    dynamic_skin: bool = False  # looked for when all else is known, so no part of the fingerprint
    content: str = ""  # a digest of the film's files, where another content is another film

    def __post_init__(self) -> None:
        if self.dynamic_skin and self.landmarks_only:
            raise InputError(
                "--dynamic-skin looks at the pictures of all frames, which --landmarks-only leaves "
                "out; leave one of them away."
            )
        for name in self.freeze:
            if name in NEVER_FROZEN or name not in PARAMETERS:
                free = ", ".join(one for one in PARAMETERS if one not in NEVER_FROZEN)
                raise InputError(f"--freeze {name}: a sequence can hold {free}.")

    @property
    def passes(self) -> int:
        """How often the pictures of all frames are looked at."""
        return 0 if self.landmarks_only else PASSES[self.quality]

    @property
    def fingerprint(self) -> str:
        """Changes when anything that the answer depends on changes, but for what files hold that
        ``content`` does not speak of.
        """
        camera = None if self.camera is None else self.camera.to_json()
        said = [str(self.film.resolve()), self.rate, self.model, camera, self.focal_px, self.freeze]
        said += [self.quality, self.landmarks_only, self.face, self.seed]
        said += [self.content] if self.content else []
        return hashlib.sha256(json.dumps(said).encode()).hexdigest()
