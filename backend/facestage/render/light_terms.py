"""What the ray tracer is asked about light, and what it answers: plain numpy, no renderer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from facestage.contract.light_stage import LightStage


@dataclass(frozen=True)
class LitPoints:
    """P points and N lights in the tracer's frame.

    ``keys`` name the points and ``numbers`` the lights across calls, such as by pixel: what keeps
    its name keeps its random numbers when others come or go (common random numbers).
    """

    points: np.ndarray  # (P, 3) m
    normals: np.ndarray  # (P, 3) unit, of the shading
    facing: np.ndarray  # (P, 3) unit, geometric, on the viewer's side
    views: np.ndarray  # (P, 3) unit, towards the camera
    stage: LightStage
    roughness: float | np.ndarray  # one value or (P,)
    keys: np.ndarray  # (P,) int
    numbers: np.ndarray  # (N,) int

    def part(self, points: np.ndarray) -> LitPoints:
        """The points of these indices (K,), under all lights."""
        rough = self.roughness
        return LitPoints(
            self.points[points],
            self.normals[points],
            self.facing[points],
            self.views[points],
            self.stage,
            rough[points] if isinstance(rough, np.ndarray) and rough.ndim else rough,
            self.keys[points],
            self.numbers,
        )


@dataclass(frozen=True)
class Asked:
    """What of the light terms is wanted: the rest costs nothing and is zero, or empty."""

    specular: bool = True
    shadows: bool = True
    by_surface: bool = False  # derivatives by normal and depth
    by_roughness: bool = False
    # also work on lights that lie behind a point's normal: they add exactly nothing
    behind: bool = False


PLAIN = Asked()


def _not_asked() -> np.ndarray:
    return np.zeros(0, np.float32)


@dataclass(frozen=True)
class LightTerms:
    """Irradiance of P points from N lights at unit radiance; self-shadows included.

    ``diffuse`` is the integral of (n.l) over the visible solid angle, ``specular`` that of
    (n.l) D V F. The derivatives are summed over the lights at the radiance that was given, one row
    per color channel, and keep the visibility fixed; ``*_by_depth`` moves the point along its view
    ray (away from the camera, per metre); they are empty unless asked for.
    """

    diffuse: np.ndarray  # (P, N)
    specular: np.ndarray  # (P, N), zero where it was left out
    diffuse_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels, 3)
    specular_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels, 3)
    diffuse_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    specular_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    specular_by_roughness: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    pairs: int = 0  # of point and light that were worked on
    # (3 channels, P, N) irradiance by light that other skin sends; empty: none. No derivative above
    # knows of it.
    indirect: np.ndarray = field(default_factory=_not_asked)

    def under(self, radiance: np.ndarray) -> LightTerms:
        """The same of three lights, which send what all send together in red, green and blue under
        ``radiance`` (N, 3): at a radiance of 1 each in its own channel they light alike, in little
        memory.
        """
        radiance = np.asarray(radiance, np.float32)
        indirect = self.indirect
        if indirect.size:
            total = np.einsum("cpn,nc->cp", self.indirect, radiance)
            indirect = total[:, :, None] * np.eye(3, dtype=np.float32)[:, None]
        return replace(
            self,
            diffuse=self.diffuse @ radiance,
            specular=self.specular @ radiance,
            indirect=indirect,
        )

    def part(self, points: np.ndarray) -> LightTerms:
        """Those of some ``points``, by number or bool."""
        known = {item.name: getattr(self, item.name) for item in fields(self)}
        del known["pairs"]
        indirect = known.pop("indirect")
        part = {name: each[points] if each.size else each for name, each in known.items()}
        if indirect.size:
            indirect = indirect[:, points]
        return replace(self, **part, indirect=indirect)

    @classmethod
    def joined(cls, parts: Sequence[LightTerms]) -> LightTerms:
        """Of points one after another, under the same lights."""
        whole = {
            item.name: np.concatenate(
                [getattr(part, item.name) for part in parts],
                axis=1 if item.name == "indirect" and parts[0].indirect.size else 0,
            )
            for item in fields(cls)
            if item.name != "pairs"
        }
        return cls(**whole, pairs=sum(part.pairs for part in parts))

    @classmethod
    def dark(cls, points: int, lights: int, asked: Asked) -> LightTerms:
        """Terms of no point, or of no light."""
        none, channels = np.zeros((points, lights), np.float32), np.zeros((points, 3), np.float32)
        terms = cls(none, none)
        if asked.by_surface:
            vectors = np.zeros((points, 3, 3), np.float32)
            terms = replace(
                terms,
                diffuse_by_normal=vectors,
                specular_by_normal=vectors,
                diffuse_by_depth=channels,
                specular_by_depth=channels,
            )
        return replace(terms, specular_by_roughness=channels) if asked.by_roughness else terms
