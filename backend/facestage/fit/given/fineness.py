"""How fine a fit is where its job does not say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from facestage.contract.job import DRAFT_TEXTURE_SIZE, USUAL_TEXTURE_SIZE, Job
from facestage.contract.quality import DRAFT

# Texels along the atlas per pixel of the face: the face fills about half of it.
TEXELS_PER_FACE_PX = 3.0


@dataclass(frozen=True)
class Fineness:
    """Sizes and limits that every fit has; other ones suit photos of a few pixels."""

    specular_size: int = 32  # texels along the map of c_spec that is fitted with all else
    # Texels along the atlas, and along the maps of specular and roughness.
    texture_min: int = 512
    texture_max: int = USUAL_TEXTURE_SIZE
    gloss_texture: int = 256
    relief_texture: int = 1024  # texels at most along the maps of height and normals
    picture_rays: float = 2.5e7  # shadow rays of the final picture, about
    # Pixels of a photo that is worked on as it is; of a larger one the face's longer side has so
    # many at most, at three texels of the largest texture for each.
    photo_pixels: int = 2_000_000
    face_px: float = 600.0
    whole_face_px: float = math.inf  # of the face in a photo of few pixels that is left as it is
    # Of a draft: the largest textures, which its face has no more pixels than fill, unless a finer
    # one is asked for, and the final picture's rays.
    draft_texture: int = DRAFT_TEXTURE_SIZE
    draft_relief: int = 512
    draft_rays: float = 1.5e7
    # Several photos of one person are kept small while they are fitted, twice what the last phase
    # looks at.
    joint_face_px: float = 320.0
    keyframes: int = 4  # of a film, to which its person is fitted, at most
    steps_max: int | None = None  # of each phase with a photo; None: as the schedule has it
    # A phase that ends at its last step has settled when this lowered the photo's residual by less
    # than this share; else the last phase of a schedule goes on for a while.
    settled_share: float = 0.05
    report: bool = True  # whether pictures and a page show each result

    def of(self, job: Job) -> Fineness:
        """What the ``job`` asks for: as many texels along the albedo at most, and of a draft no
        more than a first look shows.
        """
        drafted = job.quality == DRAFT
        texture = job.texture_size
        if texture is None:
            texture = min(self.texture_max, self.draft_texture) if drafted else self.texture_max
        found = replace(self, texture_max=texture, texture_min=min(self.texture_min, texture))
        if not drafted:
            return found
        shown = max(texture, self.draft_texture) / TEXELS_PER_FACE_PX
        return replace(
            found,
            face_px=min(self.face_px, shown),
            whole_face_px=min(self.whole_face_px, shown),
            relief_texture=min(self.relief_texture, self.draft_relief),
            picture_rays=min(self.picture_rays, self.draft_rays),
        )

    @property
    def of_steps(self) -> dict[str, Any]:
        """What the steps of a fit depend on."""
        return {name: value for name, value in vars(self).items() if name != "report"}

    @property
    def painted_face_px(self) -> float:
        """Pixels of a face that fill the largest texture."""
        return max(self.face_px, self.texture_max / TEXELS_PER_FACE_PX)


USUAL = Fineness()
