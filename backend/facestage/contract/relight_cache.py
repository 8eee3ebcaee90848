"""A fitted face under each light alone, so that any other radiance of the same lights is one small
product.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Float, Float32, Int32, Integer, Num
from facestage.contract.camera import PIXELS_MAX, SIDE_MAX
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.files.reading import GIB, read_bytes
from facestage.contract.files.storage import finite, read_arrays, write_arrays
from facestage.contract.result import TEXTURE_MAX, Result
from facestage.contract.schemas.array_field import WHOLE, Array, Words
from facestage.contract.schemas.schema import FileSchema, checked
from facestage.contract.texture_maps import TEXTURE_MAPS

RELIGHT_CACHE = "relight.npz"
# Raise it when the forward model changes, so that no cache of the former one is used.
VERSION = 1
ARRAYS = ("size", "pixels", "coverage", "images", "scale", "samples", "fingerprint")
CACHE_ARRAYS_MAX = 2 * GIB
# Coverage and images are rounded to half floats; an image's brightest value is 1.
COVERAGE_MAX, IMAGE_MAX, SCALE_MAX, SAMPLES_MAX = 1.01, 1.01, 1e15, 10**6


@dataclass(frozen=True)
class RelightCache:
    """One image for each of the N lights of a result's stage, off ones too, of the P pixels that
    see the head.

    The image is linear in the lights (Dib et al. 2019, eq. 4 for a fixed scene): a pixel's color is
    sum_j radiance_j * images_j. Albedo and c_spec are already in it, averaged over the pixel
    together with the irradiance, so that edges are as anti-aliased as in a picture that is traced.
    """

    width: int  # of the whole picture, pixels
    height: int
    pixels: Int32[np.ndarray, " pixels"]  # row * width + column, ascending
    coverage: Float32[np.ndarray, " pixels"]  # share of the pixel that the head covers
    # linear RGB, each light at the radiance 1 / its scale
    images: Float32[np.ndarray, "3 lights pixels"]
    scale: Float32[np.ndarray, " lights"]  # the brightest value of each light's image at radiance 1
    samples: int  # shadow rays per light and sub-pixel
    fingerprint: str  # of the result that it was made from, see :func:`relight_fingerprint`

    @classmethod
    def of_images(
        cls,
        width: int,
        height: int,
        pixels: Integer[np.ndarray, " pixels"],
        coverage: Float[np.ndarray, " pixels"],
        images: Float[np.ndarray, "3 lights pixels"],
        samples: int,
        fingerprint: str,
    ) -> RelightCache:
        """The cache of ``images`` at radiance 1; rounds them as the file does (half
        floats).

        Half floats have 11 bits from 6e-5 up; each light is scaled to 1, so that a small or distant
        light keeps them.
        """
        peak = images.max(axis=(0, 2), initial=0.0).astype(np.float32)
        scale = np.where(peak > 0, peak, np.float32(1))
        rounded = np.empty(images.shape, np.float32)
        for channel in range(3):  # one at a time: a large photo's images are hundreds of megabytes
            rounded[channel] = (images[channel] / scale[:, None]).astype(np.float16)
        return cls(
            width,
            height,
            pixels.astype(np.int32),
            coverage.astype(np.float32),
            rounded,
            scale,
            samples,
            fingerprint,
        )

    def __len__(self) -> int:
        """Number of lights."""
        return self.images.shape[1]

    def colors(self, radiance: Num[np.ndarray, " ..."]) -> Float32[np.ndarray, "pixels 3"]:
        """Linear RGB of :attr:`pixels` under the lights' ``radiance`` (lights, 3).

        Raises InputError for another number of lights, or radiance that is negative or not finite.
        """
        radiance = np.asarray(radiance, np.float64)
        if (
            radiance.shape != (len(self), 3)
            or not np.isfinite(radiance).all()
            or (radiance < 0).any()
        ):
            raise InputError(
                f"The radiance to relight with has shape {radiance.shape}; expected ({len(self)}, "
                "3) finite numbers of 0 or more, one row per light of the stage."
            )
        weights = (radiance * self.scale[:, None]).astype(np.float32)
        result = np.empty((len(self.pixels), 3), np.float32)
        for channel in range(3):
            # Not BLAS: it is bound by memory either way, and BLAS waits for its threads where
            # others keep them busy.
            result[:, channel] = np.einsum("j,jp->p", weights[:, channel], self.images[channel])
        return result

    def relight(self, radiance: Num[np.ndarray, " ..."]) -> Float32[np.ndarray, "height width 3"]:
        """Linear RGB under ``radiance`` (lights, 3), 0 where the head is not; see :meth:`colors`.

        The same as tracing the result again with the same samples, to a relative 5e-4 (half
        floats).
        """
        picture = np.zeros((self.height * self.width, 3), np.float32)
        picture[self.pixels] = self.colors(radiance)
        return picture.reshape(self.height, self.width, 3)

    def save(self, folder: Path) -> None:
        """Write the cache into a result folder, whole or not at all; 6 bytes per light and pixel of
        the head.
        """
        arrays = {
            "size": np.array([self.width, self.height], np.int32),
            "pixels": self.pixels,
            "coverage": self.coverage.astype(np.float16),
            "images": self.images.astype(np.float16),
            "scale": self.scale,
            "samples": np.array(self.samples),
            "fingerprint": np.array(self.fingerprint),
        }
        write_arrays(Path(folder) / RELIGHT_CACHE, arrays, compress=False)

    @classmethod
    def load(cls, result: Result) -> RelightCache:
        """The cache in the folder of ``result``.

        Raises InputError when there is none, or it is damaged or stale.
        """
        assert result.folder is not None
        path = result.folder / RELIGHT_CACHE
        remedy = f"make it with Prepare Relight, or with: facestage render {result.folder} --cache"
        if not is_file(path):
            raise InputError(f"The result '{result.folder}' has no relight cache; {remedy}.")
        arrays = read_arrays(path, "relight cache", CACHE_ARRAYS_MAX)
        subject = f"The relight cache '{path}'"
        found = checked(
            CacheSchema(lights=len(result.stage)), arrays, f"{subject} is damaged", remedy
        )
        if set(arrays) != set(ARRAYS) or found["fingerprint"] != relight_fingerprint(result):
            raise InputError(f"{subject} belongs to another state of the result; {remedy}.")
        width, height = map(int, found["size"])
        pixels = found["pixels"]
        if width > result.camera.width or height > result.camera.height:
            raise InputError(
                f"{subject} is damaged (its picture is larger than the photo); {remedy}."
            )
        if len(pixels) and (pixels[-1] >= width * height or (np.diff(pixels) <= 0).any()):
            raise InputError(
                f"{subject} is damaged (its pixels are no places in a picture, in order); {remedy}."
            )
        return cls(
            width,
            height,
            pixels.astype(np.int32),
            found["coverage"].astype(np.float32),
            found["images"].astype(np.float32),
            found["scale"].astype(np.float32),
            int(found["samples"]),
            found["fingerprint"],
        )


class CacheSchema(FileSchema):
    """A relight.npz of a result with a known number of lights."""

    size = Array((2,), WHOLE, minimum=1, maximum=SIDE_MAX)
    pixels = Array(("pixels",), WHOLE, minimum=0, maximum=PIXELS_MAX)
    coverage = Array(("pixels",), minimum=0, maximum=COVERAGE_MAX)
    images = Array((3, "lights", "pixels"), minimum=0, maximum=IMAGE_MAX)
    scale = Array(("lights",), minimum=0, maximum=SCALE_MAX)
    samples = Array((), WHOLE, minimum=1, maximum=SAMPLES_MAX)
    fingerprint = Words()


def relight_fingerprint(result: Result) -> str:
    """Changes with everything that the one-light images depend on, except the samples; not with the
    radiance.

    Shape and pose, camera, the lights' places and sizes, roughness, seed, and the texture files of
    the folder.
    """
    assert result.folder is not None
    stage = result.stage
    digest = hashlib.sha256(f"relight {VERSION}\n".encode())
    digest.update(
        json.dumps(
            finite([result.model, result.camera.to_json(), result.seed]), sort_keys=True
        ).encode()
    )
    numbers = (
        result.camera_to_stage,
        result.model_to_camera,
        result.identity,
        result.expression,
        result.vertices,
        result.triangles,
        stage.position,
        stage.direction,
        stage.axis_x,
        stage.side,
        result.roughness,
    )
    for array in numbers:
        values = np.ascontiguousarray(array, np.float64)
        digest.update(f"{values.shape}".encode() + values.tobytes())
    for each in TEXTURE_MAPS:
        if not each.required and not is_file(result.folder / each.file):
            continue
        content = read_bytes(result.folder / each.file, "result's texture", TEXTURE_MAX)
        digest.update(f"{len(content)}\n".encode() + content)
    return digest.hexdigest()
