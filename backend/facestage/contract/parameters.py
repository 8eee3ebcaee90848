"""What a fit may change, as jobs name it and result folders keep it: one row per parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

from facestage.contract.scattering import STRENGTH_MAX, TRANSLUCENCY_MAX
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import Checked, Number

WEIGHT_MAX = 1e6  # of identity, expression and albedo: nothing that a fit can reach
SPECULAR_MAX = 100.0
# The least and the largest of the sizes that shapes have names for.
SIZES: Mapping[str, tuple[int, int]] = MappingProxyType({"texels": (1, 4096)})


@dataclass(frozen=True)
class Values:
    """Numbers in a file: their shape, with a name for each size that varies, and their range."""

    shape: tuple[int | str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None

    def array(self, **options: Any) -> Array:
        """The field of an .npz; ``options`` are marshmallow's."""
        return Array(self.shape, minimum=self.minimum, maximum=self.maximum, **options)

    def json(self, **options: Any) -> Checked:
        """The field of a JSON file: a number, or nested lists."""
        if not self.shape:
            return Number(self.minimum, self.maximum, **options)
        return self.array(**options)


@dataclass(frozen=True)
class Parameter:
    """A row."""

    keep: str  # what freezing it does, in the words of the user interface
    values: Values | None = None  # as a result keeps it; None: as camera, pose or light stage
    shared: bool = False  # photos of one person have one of it
    required: bool = True  # False: folders that older versions wrote lack it


# Jobs freeze a parameter by its name. A .blend file knows it by the number of its row: new rows go
# last, and none is taken out.
TABLE: Mapping[str, Parameter] = MappingProxyType(
    {
        "identity": Parameter(
            "Keep the head shape that the identity sliders show",
            Values(("identity",), -WEIGHT_MAX, WEIGHT_MAX),
            shared=True,
        ),
        "expression": Parameter(
            "Keep the expression that the sliders show",
            Values(("expression",), -WEIGHT_MAX, WEIGHT_MAX),
        ),
        "pose": Parameter("Keep the head where it is in the stage"),
        "albedo": Parameter(
            "Keep the model's mean skin color",
            Values(("albedo",), -WEIGHT_MAX, WEIGHT_MAX),
            shared=True,
        ),
        "specular": Parameter(
            "Keep the specular map of a plain dielectric",
            Values(("texels", "texels"), 0, SPECULAR_MAX),
            shared=True,
        ),
        "roughness": Parameter("Keep the material's roughness", Values((), 0, 1), shared=True),
        "lights": Parameter("Keep every light at its present color and power"),
        "light_position": Parameter("Where strong lights stand on the hemisphere"),
        "focal": Parameter("Keep the focal length"),
        "relief": Parameter(
            "Keep to the shapes of the face model: no relief beyond them", shared=True
        ),
        "interreflection": Parameter(
            "Keep how much light goes from skin to skin", Values((), 0, 2), required=False
        ),
        "scattering": Parameter(
            "Keep how far light wanders below the skin", Values((), 0, STRENGTH_MAX), required=False
        ),
        "translucency": Parameter(
            "Keep how much more light comes out of slanting and bulging skin",
            Values((), 0, TRANSLUCENCY_MAX),
            required=False,
        ),
    }
)
PARAMETERS = tuple(TABLE)
# What a result, and of the shared ones a person, keeps as numbers under their own names.
KEPT: Mapping[str, Values] = MappingProxyType(
    {name: row.values for name, row in TABLE.items() if row.values is not None}
)


def result_arrays() -> dict[str, Checked]:
    """The fields of the arrays of a result, by name."""
    return {name: values.array(required=TABLE[name].required) for name, values in KEPT.items()}


def shared_values() -> dict[str, Checked]:
    """The fields of what JSON says of a person, by name."""
    return {
        name: values.json(required=TABLE[name].required)
        for name, values in KEPT.items()
        if TABLE[name].shared
    }


def as_fields(owner: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """``values`` by name as arguments of the dataclass ``owner``, whose field ``further`` takes
    those that are no field of it.
    """
    own = {field.name for field in fields(owner)}
    further = {name: value for name, value in values.items() if name not in own}
    return {name: value for name, value in values.items() if name in own} | {"further": further}
