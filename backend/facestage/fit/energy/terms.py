"""The terms that there are. A new one is a file beside these and a line here."""

from __future__ import annotations

from facestage.fit.energy.breadth_term import BreadthTerm
from facestage.fit.energy.exposure_term import ExposureTerm
from facestage.fit.energy.gaze_term import GazeTerm
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.lid_term import LidTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.pin_term import PinTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.silhouette import SilhouetteTerm
from facestage.fit.energy.teeth_term import TeethTerm
from facestage.fit.energy.term import Term
from facestage.fit.energy.tone_term import ToneTerm
from facestage.fit.energy.whites_term import WhitesTerm

TERMS: tuple[type[Term], ...] = (
    Priors,
    LandmarkTerm,
    LidTerm,
    GazeTerm,
    BreadthTerm,
    PinTerm,
    SilhouetteTerm,
    WhitesTerm,
    TeethTerm,
    ExposureTerm,
    ToneTerm,
    PhotoTerm,
)


def words_of_energies() -> dict[str, str]:
    """What people call each energy of a result, by its name."""
    return {name: words for term in TERMS for name, words in term.words.items()}
