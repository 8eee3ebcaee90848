"""Contenders of a bench that are done in seconds on the synthetic face."""

from __future__ import annotations

from dataclasses import replace

from facestage.bench.settings import HARMONICS, AdamSettings, SolverSettings
from reference.small_fit import SMALL

TINY = (
    SolverSettings("Facestage", resolution=0.4, samples=0.5),
    AdamSettings("Adam", resolution=0.4, iterations=3),
    SolverSettings("Harmonics", HARMONICS, resolution=0.4),
)
SHORT = replace(SMALL, steps_max=2)
