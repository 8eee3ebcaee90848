"""All terms of the energy E_data + w1 E_prior + w2 E_light (Dib et al. 2019, eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from facestage.contract.job import Weights
from facestage.contract.light_stage import LightStage
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters

if TYPE_CHECKING:
    from facestage.fit.energy.silhouette import SilhouetteTerm
from facestage.fit.energy.photo_term import PhotoTerm


@dataclass(frozen=True)
class Energy:
    """All terms of a stage."""

    layout: Layout
    priors: Priors
    landmarks: LandmarkTerm
    weights: Weights
    light_parameters: LightParameters
    photo: PhotoTerm | None = None
    stage: LightStage | None = None  # camera frame
    silhouette: SilhouetteTerm | None = None
