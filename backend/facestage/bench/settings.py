"""What a bench compares: each contender's settings, and which contenders a run has."""

from __future__ import annotations

from dataclasses import dataclass, field

from facestage.contract.quality import BEST, DRAFT, GOOD

OURS, ADAM, HARMONICS = "ours", "adam", "harmonics"
FAMILIES = {
    OURS: "Facestage: ray-traced, Gauss-Newton",
    ADAM: "Mitsuba + Adam, same energy",
    HARMONICS: "Spherical harmonics + Lambert, Gauss-Newton",
}


@dataclass(frozen=True)
class SolverSettings:
    """The fit, or the fit with spherical harmonics for light: factors on the default schedule."""

    name: str
    family: str = OURS
    resolution: float = 1.0  # of the pixels along a side, every photo phase
    samples: float = 1.0  # of the light samples
    budget: float | None = None  # seconds
    quality: str = GOOD
    # whether the derivatives know how cast shadows move; None: as a fit does
    shadow_edges: bool | None = None
    # which part of the light's model is left out, of PARTS
    without: str = ""


@dataclass(frozen=True)
class Rates:
    """Adam's learning rates: a parameter's change per iteration at the start."""

    turn: float = 0.006  # radians
    shift: float = 0.001  # m
    identity: float = 0.1  # standard deviations
    expression: float = 0.03
    lights: float = 0.02  # of the mean radiance
    albedo: float = 0.08  # standard deviations
    roughness: float = 0.01
    specular: float = 0.04


@dataclass(frozen=True)
class AdamSettings:
    """Mitsuba + Adam: paths per pixel, the face's size as a factor on the fit's finest, when it
    stops.
    """

    name: str
    samples: int = 4
    resolution: float = 1.0
    budget: float = 60.0  # seconds
    iterations: int = 2000  # at most
    rates: Rates = field(default_factory=Rates)
    family: str = ADAM


SURROUND = "surround"
# The parts of the light's model that a fit can do without: lights behind the face, and unknowns.
PARTS = {
    SURROUND: "no light from behind",
    "interreflection": "no light from skin to skin",
    "scattering": "no light below the skin",
    "translucency": "light out of the skin evenly",
}
Contender = SolverSettings | AdamSettings
DEFAULT = SolverSettings("Facestage")
# On every case: what the quality names of a budget buy.
QUALITY: tuple[SolverSettings, ...] = (
    SolverSettings(DRAFT, quality=DRAFT),
    SolverSettings(BEST, quality=BEST),
)
BASELINE = AdamSettings("Adam", budget=90.0)
HARMONIC = SolverSettings("Harmonics", HARMONICS)
# What a default run compares on every case.
MAIN: tuple[Contender, ...] = (DEFAULT, BASELINE, HARMONIC)
# What is varied, one thing at a time, on the first case only.
SWEEP: tuple[Contender, ...] = (
    SolverSettings("half the resolution", resolution=0.5),
    SolverSettings("1.5 times the resolution", resolution=1.5),
    SolverSettings("half the light samples", samples=0.5),
    SolverSettings("4 times the light samples", samples=4.0),
    SolverSettings("moving shadows", shadow_edges=True),
    SolverSettings("budget 2 s", budget=2.0),
    SolverSettings("budget 5 s", budget=5.0),
    SolverSettings("budget 10 s", budget=10.0),
    AdamSettings("Adam, 16 paths a pixel", samples=16),
    AdamSettings("Adam, 0.4 times the resolution", resolution=0.4, samples=16, budget=45.0),
)


@dataclass(frozen=True)
class Lineup:
    """What a bench runs: the main contenders and qualities on every case, the sweep on the
    first.
    """

    main: tuple[Contender, ...] = MAIN
    qualities: tuple[Contender, ...] = QUALITY
    sweep: tuple[Contender, ...] = SWEEP
    warm_up: bool = True  # compile each contender's kernels first, so that nobody's clock counts it


QUICK: tuple[Contender, ...] = (DEFAULT, AdamSettings("Adam", budget=30.0), HARMONIC)

WHOLE_LINEUP = Lineup()
QUICK_LINEUP = Lineup(QUICK, (), ())
ALONE_LINEUP = Lineup((DEFAULT,), (), ())
PARTS_LINEUP = Lineup(
    (DEFAULT, *(SolverSettings(words, without=name) for name, words in PARTS.items())), (), ()
)
