"""Contenders of a bench that are done in seconds on the synthetic face."""

from __future__ import annotations

from facestage.bench.settings import HARMONICS, AdamSettings, SolverSettings

TINY = (
    SolverSettings("Facestage", resolution=0.4, samples=0.5),
    AdamSettings("Adam", resolution=0.4, iterations=3),
    SolverSettings("Harmonics", HARMONICS, resolution=0.4),
)
