"""The unknowns of a fit: one row each.

The layout of the vector of increments, its bounds, the priors, checkpoints, what photos of one
person share, what each phase moves and where a fit starts are made from these rows. By which name a
job freezes an unknown, and how a result keeps it, is the row of the same name in
:mod:`facestage.contract.parameters`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract import brdf
from facestage.contract.arrays import Bool, Float
from facestage.contract.face_model import FaceModel
from facestage.contract.light_stage import FAR
from facestage.contract.parameters import KEPT, TABLE, Values
from facestage.fit.face.gaussians import Gaussian, Relative, independent, level, smooth, tied
from facestage.fit.face.lamps import spacing
from facestage.fit.face.light_color import LightPrior
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.white_balance import WhiteBalance

# Ten standard deviations is no face; the bound keeps a wild step from leaving float range.
WEIGHT_RANGE = (-10.0, 10.0)
FOCAL_SIGMA = 0.25  # of the logarithm, when the lens is unknown
# Expressions of photographed faces: most blendshapes near 0, few above a half.
EXPRESSION_SIGMA = 0.35
# How far a lamp stands from the nearest light of the lattice, in spacings of the lattice.
LIGHT_POSITION_SHARE = 0.4
ROUGHNESS_MEAN, ROUGHNESS_SIGMA = 0.40, 0.10  # skin, Weyrich et al. 2006
# c_spec = 0.7 is skin's index of 1.4; of 0.4, dark skin is three degrees lighter
# (docs/skin-tone.md).
SPECULAR_MEAN, SPECULAR_SIGMA = 0.8, 0.25
# Difference of neighbouring texels where the mean is the usual one. Of 0.25, the map takes up what
# lamps and shape leave over, and gloss that is none makes skin dark (docs/skin-tone.md).
SPECULAR_SMOOTHNESS = 0.15
# Light between skin and skin is there in every photo (1), in pictures of direct light alone not.
INTERREFLECTION_MEAN, INTERREFLECTION_SIGMA = 1.0, 0.3
INTERREFLECTION_MAX = 1.5
# How far light wanders below the skin: about as far as published (1), not at all where the photo
# does not say.
SCATTERING_SIGMA, SCATTERING_MAX = 1.0, 3.0
# How unevenly light comes out of the skin: between opaque (0) and as of a random walk (1).
TRANSLUCENCY_MEAN, TRANSLUCENCY_SIGMA = 0.5, 0.5
TRANSLUCENCY_MAX = 1.5


@dataclass(frozen=True)
class Known:
    """What bounds and priors depend on: what is known of one photo before it is fitted."""

    lights: LightParameters
    focal_px: float
    focal_sigma: float = FOCAL_SIGMA  # standard deviation of the logarithm of the focal length
    # Which expressions, or whether all, have weights in 0..1; others are Gaussian.
    expression_box: bool | Bool[np.ndarray, " expressions"] = True
    # The mean radiance that E_light is relative to. Fixed, so that black is no escape.
    light_scale: float = 1.0
    # Lights of the stage's hemisphere, those that are off too; None: as many as ``lights`` has.
    stage_lights: int | None = None
    # The weights that expressions are likely to have: of what shuts an eye that landmarks see shut.
    expression_mean: float | Float[np.ndarray, " expressions"] = 0.0
    # Standard deviations of those in 0..1: a jaw whose teeth are seen closed has a small one.
    expression_sigma: float | Float[np.ndarray, " expressions"] = EXPRESSION_SIGMA
    white: WhiteBalance | None = None  # what something grey in the photo shows of the light
    # Sums of expressions' weights that are likely to be 0, in standard deviations: eyes look the
    # same way.
    expression_ties: Float[np.ndarray, "ties expressions"] | None = None

    @property
    def spacing(self) -> float:
        """Radians between neighbouring lights of the stage."""
        count = len(self.lights.fitted) if self.stage_lights is None else self.stage_lights
        return spacing(count)


Range = tuple[float | np.ndarray, float | np.ndarray]
# From what is known and the number of values.
Prior = Callable[[Known, int], Gaussian | Relative | LightPrior]


@dataclass(frozen=True)
class Unknown:
    """A row. By default an unknown is the state's field of its name, a number or an array."""

    name: str
    group: str  # what it moves with: see SHAPE, RELIEF, SKIN, LAMPS, GLOSS and BELOW
    bounds: Range | Callable[[Known], Range] = (-np.inf, np.inf)
    priors: Mapping[str, Prior] = field(default_factory=dict)  # by their energy's name
    weight: str = "prior"  # which of the job's weights its priors have
    mean: float = 0.0  # where a fit starts, where the job does not say and the photo does not tell
    counted: bool = True  # among the directions that the data see or do not see
    # The state's fields that it is made of, with their numbers; None: an object, not numbers.
    parts: Mapping[str, Values | None] | None = None
    # Its values, to which a step is added, and the fields of the state that has other values.
    read: Callable[[State], np.ndarray] | None = None
    write: Callable[[State, np.ndarray], Mapping[str, Any]] | None = None

    @property
    def fields(self) -> Mapping[str, Values | None]:
        """The state's fields that it is made of, with their numbers in a checkpoint."""
        return {self.name: KEPT[self.name]} if self.parts is None else self.parts

    def values(self, state: State) -> Float[np.ndarray, " values"]:
        """Its values at ``state``."""
        return np.ravel(getattr(state, self.name)) if self.read is None else self.read(state)

    def changes(self, state: State, values: Float[np.ndarray, " values"]) -> Mapping[str, Any]:
        """The fields of ``state`` that change for its ``values`` to be those."""
        if self.write is not None:
            return self.write(state, values)
        return {self.name: _plain(values.reshape(np.shape(getattr(state, self.name))))}

    def limits(self, known: Known) -> Range:
        """Lower and upper bounds of its values."""
        return self.bounds(known) if callable(self.bounds) else self.bounds


def normal(mean: float, sigma: float) -> Prior:
    """Each value by itself."""
    return lambda known, count: independent(count, mean, sigma)


def _turned(state: State, increment: Float[np.ndarray, " 6"]) -> Mapping[str, Any]:
    """``increment``: by SO(3) about the model's origin, then by metres."""
    turn = Rotation.from_rotvec(increment[:3]).as_matrix()
    return {"rotation": turn @ state.rotation, "translation": state.translation + increment[3:]}


def _log_focal(state: State) -> Float[np.ndarray, " 1"]:
    return np.array([np.log(state.camera.focal_px)])


def _with_log_focal(state: State, values: Float[np.ndarray, " 1"]) -> Mapping[str, Any]:
    return {"camera": replace(state.camera, focal_px=float(np.exp(values[0])))}


def _focal_prior(known: Known, count: int) -> Gaussian:
    return independent(count, float(np.log(known.focal_px)), known.focal_sigma)


def _expression_range(known: Known) -> Range:
    box = known.expression_box
    return np.where(box, 0.0, -np.inf), np.where(box, 1.0, np.inf)


def _expression_prior(known: Known, count: int) -> Gaussian:
    sigma = np.where(known.expression_box, known.expression_sigma, 1.0)
    each = independent(count, known.expression_mean, sigma)
    return each if known.expression_ties is None else tied(each, known.expression_ties)


def _light_prior(known: Known, count: int) -> LightPrior:
    return LightPrior(known.lights, known.light_scale, white=known.white)


def _light_position_prior(known: Known, count: int) -> Gaussian:
    return independent(count, 0.0, LIGHT_POSITION_SHARE * known.spacing)


def _specular_level(known: Known, count: int) -> Gaussian:
    return level(count, SPECULAR_MEAN, SPECULAR_SIGMA)


def _specular_smooth(known: Known, count: int) -> Relative:
    return Relative(smooth(count, SPECULAR_SMOOTHNESS), SPECULAR_MEAN)


# In the order of the vector; identity, expression and relief follow each other, as in the bases of
# the shape.
UNKNOWNS = (
    Unknown(
        "pose",
        "shape",
        counted=False,
        parts={"rotation": Values((3, 3), -2, 2), "translation": Values((3,), -FAR, FAR)},
        read=lambda state: np.zeros(6),  # the step itself
        write=_turned,
    ),
    Unknown(
        "focal",
        "shape",
        priors={"focal": _focal_prior},
        counted=False,
        parts={"camera": None},
        read=_log_focal,
        write=_with_log_focal,
    ),
    Unknown("identity", "shape", bounds=WEIGHT_RANGE, priors={"identity": normal(0.0, 1.0)}),
    Unknown(
        "expression", "shape", bounds=_expression_range, priors={"expression": _expression_prior}
    ),
    # As the identity, what photos say of it together: matches alone move it.
    Unknown(
        "relief",
        "relief",
        bounds=WEIGHT_RANGE,
        priors={"relief": normal(0.0, 1.0)},
        counted=False,
        parts={"relief": Values(("reliefs",))},
    ),
    Unknown(
        "lights",
        "skin",
        bounds=(0.0, np.inf),
        priors={"light": _light_prior},
        weight="light",
        parts={"lights": Values(("parameters",))},
    ),
    Unknown(
        "light_position",
        "lamps",
        bounds=lambda known: (-known.spacing, known.spacing),
        priors={"light_position": _light_position_prior},
        counted=False,
        parts={"light_position": Values(("lights", 2))},
    ),
    Unknown("albedo", "skin", bounds=WEIGHT_RANGE, priors={"albedo": normal(0.0, 1.0)}),
    Unknown(
        "roughness",
        "gloss",
        bounds=(brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX),
        priors={"roughness": normal(ROUGHNESS_MEAN, ROUGHNESS_SIGMA)},
        mean=ROUGHNESS_MEAN,
    ),
    Unknown(
        "specular",
        "gloss",
        bounds=(0.0, brdf.SPECULAR_MAX),
        priors={"specular_level": _specular_level, "specular_smooth": _specular_smooth},
        mean=SPECULAR_MEAN,
        counted=False,
    ),
    Unknown(
        "interreflection",
        "skin",
        bounds=(0.0, INTERREFLECTION_MAX),
        priors={"interreflection": normal(INTERREFLECTION_MEAN, INTERREFLECTION_SIGMA)},
        mean=INTERREFLECTION_MEAN,
        counted=False,
    ),
    Unknown(
        "scattering",
        "below",
        bounds=(0.0, SCATTERING_MAX),
        priors={"scattering": normal(0.0, SCATTERING_SIGMA)},
        counted=False,
    ),
    Unknown(
        "translucency",
        "skin",
        bounds=(0.0, TRANSLUCENCY_MAX),
        priors={"translucency": normal(TRANSLUCENCY_MEAN, TRANSLUCENCY_SIGMA)},
        mean=TRANSLUCENCY_MEAN,
        counted=False,
    ),
)
BLOCKS = tuple(unknown.name for unknown in UNKNOWNS)
# One person has one shape and one skin; pose, expression, lens and light are the photo's.
SHARED = tuple(name for name in BLOCKS if TABLE[name].shared)


def _group(name: str) -> tuple[str, ...]:
    return tuple(unknown.name for unknown in UNKNOWNS if unknown.group == name)


# What moves together. Shape: points and normals; skin: light and albedo, of which each explains
# what the other does not; relief: what no coefficient of the face model says of the shape.
# Below: how far light wanders below the skin, which pixels of a millimetre or two show.
SHAPE, RELIEF, SKIN, LAMPS, GLOSS, BELOW = (
    _group(name) for name in ("shape", "relief", "skin", "lamps", "gloss", "below")
)

# What moves points and normals.
SURFACE = SHAPE + RELIEF

STATE_FIELDS: Mapping[str, Values | None] = MappingProxyType(
    {name: values for unknown in UNKNOWNS for name, values in unknown.fields.items()}
)
# What checkpoints of versions that did not know it lack.
LATER_FIELDS = frozenset(
    each.name
    for each in fields(State)
    if each.default is not MISSING or each.default_factory is not MISSING
)


def with_unknowns(state: State, other: State, names: Collection[str]) -> State:
    """``state`` with the unknowns ``names`` of another."""
    chosen = [unknown for unknown in UNKNOWNS if unknown.name in names]
    return replace(
        state, **{name: getattr(other, name) for unknown in chosen for name in unknown.fields}
    )


def kept(state: State) -> dict[str, Any]:
    """What a result keeps of ``state`` by name, beside camera, pose and light stage."""
    return {name: getattr(state, name) for name in KEPT}


def from_kept(values: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The reverse of :func:`kept`, as fields of a state."""
    return {name: _plain(value) for name, value in values.items()}


def kept_shapes(model: FaceModel, texels: int) -> dict[str, tuple[int, ...]]:
    """The shape of what a result keeps, for a face model and maps of ``texels`` along a side."""
    sizes = {
        "identity": len(model.identity_names),
        "expression": len(model.expression_names),
        "albedo": len(model.albedo_basis),
        "texels": texels,
    }
    return {
        name: tuple(sizes[size] if isinstance(size, str) else size for size in values.shape)
        for name, values in KEPT.items()
    }


def start_values(
    initial: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, Any]:
    """Where a fit starts, as fields of a state: at ``initial``, or at the mean, in ``shapes``."""
    means = {unknown.name: unknown.mean for unknown in UNKNOWNS}
    return from_kept(
        {
            name: np.array(initial.get(name, np.full(shape, means[name])), np.float64)
            for name, shape in shapes.items()
        }
    )


def _plain(value: np.ndarray) -> Any:
    """A number for an array without dimensions."""
    return float(value) if np.ndim(value) == 0 else value
