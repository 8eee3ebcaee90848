"""Wrinkles that come with an expression: a height of the skin that follows some sliders."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

from facestage.contract.schemas.fields import Checked, Items, Name
from facestage.contract.schemas.schema import FileSchema
from facestage.contract.texture_maps import HEIGHT, NORMAL, TextureMap

WRINKLES_MAX, SLIDERS_MAX = 32, 16
NAME = re.compile(r"[a-z][a-z_]{0,39}")
FILE = re.compile(rf"wrinkles_{NAME.pattern}_({NORMAL.name}|{HEIGHT.name})\.exr")


@dataclass(frozen=True)
class Wrinkles:
    """Those of one group of sliders: their strength is the mean of the sliders' values, and at 1
    the skin has the height (mm) and the normals (tangent space) of their maps, which lie over the
    UV square as a result's do, beside the sequence.
    """

    name: str
    sliders: tuple[str, ...]  # the model's expressions

    @property
    def normal_file(self) -> str:
        """The file of the normal map."""
        return self._file(NORMAL)

    @property
    def height_file(self) -> str:
        """The file of the height map."""
        return self._file(HEIGHT)

    def _file(self, each: TextureMap) -> str:
        return f"wrinkles_{self.name}_{each.file}"

    def to_json(self) -> dict[str, Any]:
        """As a file holds it."""
        return asdict(self)


class PlainName(Checked):
    """A word that files are named by."""

    def __init__(self, **options: Any) -> None:
        super().__init__("a name of small letters and underscores", **options)

    def _deserialize(self, value: Any, attr: str | None, data: Any, **kwargs: Any) -> str:
        if not isinstance(value, str) or not NAME.fullmatch(value):
            raise self.wrong(value)
        return value


class WrinklesSchema(FileSchema):
    """One group's, in a sequence.json."""

    name = PlainName()
    sliders = Items(Name(), 1, SLIDERS_MAX, unique=True)
