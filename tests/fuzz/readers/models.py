"""Face models, the landmark model, and photographs: what is done with each input."""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import warnings
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from fuzz.consistent import check_array, check_dataclass, require
from fuzz.readers.files import read_any_arrays


def check_loaded(specification: str, folder: Path) -> None:
    """The model as every command loads it, its conversion kept beside the input's folder as long as
    it is looked at.
    """
    from facestage.models.registry import load_model

    kept = folder.parent / "converted"
    with mock.patch.dict(os.environ, FACESTAGE_CACHE=str(kept)):
        try:
            check_model(load_model(specification))
        finally:
            shutil.rmtree(kept, ignore_errors=True)


def read_rig(folder: Path) -> None:
    check_loaded(f"rig:{folder / 'rig.npz'}", folder)


def read_face_model(folder: Path) -> None:
    from facestage.models.registry import load_model

    check_model(load_model(f"npz:{folder / 'face.npz'}"))


def check_model(model: Any) -> None:
    check_dataclass(model)
    require(
        len(model.expression_box) == len(model.expression_names),
        "expression_box and its names differ",
    )
    require(
        len(model.triangles) == len(model.triangle_uvs) == len(model.triangle_part),
        "triangles differ in number",
    )
    for scheme in model.landmarks:
        vertices, weights = model.landmark_vertices(scheme)
        check_array(
            np.einsum("mk,mkc->mc", weights, model.vertices[vertices]), f"landmarks {scheme}"
        )
    check_array(
        model.shape(np.ones(len(model.identity_names)), np.ones(len(model.expression_names))),
        "a shape",
    )
    check_array(model.albedo(np.zeros(len(model.albedo_basis))), "an albedo")


def read_pickled(folder: Path) -> None:
    from facestage.models.files.restricted_pickle import read_pickle

    read_pickle(folder / "a.pkl", "pickle")


def read_flame(folder: Path) -> None:
    check_loaded(f"flame:{folder}", folder)


def read_bfm(folder: Path) -> None:
    check_loaded(f"bfm:{folder}", folder)


def read_gnm(folder: Path) -> None:
    check_loaded(f"gnm:{folder}", folder)


def read_ict(folder: Path) -> None:
    files = [path for path in folder.iterdir() if path.name.startswith("ict")]
    check_loaded(f"ict:{files[0] if files else folder / 'ict'}", folder)


def read_bomb(folder: Path) -> None:
    """A file that is larger than it seems, by the reader that its name tells."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith("ict"):
            read_ict(folder)
        elif path.suffix == ".h5":
            check_loaded(f"bfm:{path}", folder)
        else:
            {".npz": read_any_arrays, ".pkl": read_pickled, ".png": read_photo}[path.suffix](folder)


def read_bundle(folder: Path) -> None:
    from facestage.landmarks.model_file import open_model

    open_model(folder / "face_landmarker.task")


def read_geometry(folder: Path) -> None:
    from facestage.landmarks.canonical import read_canonical

    face = read_canonical((folder / "geometry.binarypb").read_bytes())
    check_array(face.vertices, "the canonical face's vertices")
    require(face.triangles.min() >= 0, "a corner of the canonical face is negative")
    check_array(face.mirror, "mirror")
    check_array(face.edges, "edges")


def read_photo(folder: Path) -> None:
    from facestage.images.image_io import read_photograph

    files = sorted(folder.iterdir())
    photo = read_photograph(files[0] if files else folder / "a.png")
    check_dataclass(photo)
    size = photo.size[::-1]
    require(
        photo.color.shape == photo.clipped.shape == (*size, 3) and photo.mask.shape == size,
        "a photo's shapes differ",
    )
    require(
        photo.color.dtype == np.float32 and photo.color.min() >= 0, "a photo's colors are negative"
    )
    require(photo.focal is None or photo.focal.focal_px > 0, "a photo's lens has no length")


def read_profile(folder: Path) -> None:
    from PIL import Image

    from facestage.images.color_profile import decoder_of, through_littlecms
    from fuzz.seeds.images import picture

    data = (folder / "a.icc").read_bytes()
    decoder = decoder_of(data)
    for kind in (np.uint8, np.uint16):
        if decoder is not None:
            color = decoder(picture(3, kind))
            require(np.isfinite(color).all() and color.min() >= 0, "a profile decodes to no color")
            require(decoder.name.isprintable(), "a profile's name is not printable")
    if decoder is None:
        through_littlecms(Image.fromarray(picture(3)), data)


def read_exif(folder: Path) -> None:
    from PIL import Image

    from facestage.images.exif import focal_prior

    exif = Image.Exif()
    # What Pillow itself refuses, reading the photo refuses.
    refused = (SyntaxError, ValueError, OSError, KeyError, TypeError, struct.error)
    with contextlib.suppress(*refused), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exif.load((folder / "a.exif").read_bytes())
        exif.get_ifd(0x8769)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as reading the photo does
        found = focal_prior(exif, 24, 18)
    if found is not None:
        check_dataclass(found)
        require(found.focal_px > 0 and found.log_sigma > 0, "a lens of no length")
