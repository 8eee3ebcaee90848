"""Valid face model files of the published structures, as small as their readers allow."""

from __future__ import annotations

import gzip
import io
import json
import lzma
import pickle
import struct
import tarfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from scipy import sparse

from fuzz.case import Case
from fuzz.damage.archives import BOMB, bomb_zip, deflated_zeros, tar_bytes, zip_bytes
from fuzz.damage.images import PNG, png_chunk
from fuzz.seeds.contract import numbers, written
from reference.published.bfm import write_statismo
from reference.published.flame import embedding, flame_arrays, write_embedding, write_flame
from reference.published.gnm import gnm_arrays, write_landmarks
from reference.published.heads import head

ICT_VERTICES, ICT_POLYGONS = 26719, 26384
HEAD_VERTICES = 200


def pickles() -> list[Case]:
    """Dictionaries with everything that landmark and model files hold, of a few rows."""
    arrays = {
        "v": numbers(1, 3, 3),
        "f": np.arange(6, dtype=np.uint32).reshape(2, 3),
        "order": np.asfortranarray(numbers(2, 2, 2)),
        "sparse": sparse.csc_matrix(np.eye(3)),
        "rows": sparse.csr_matrix(np.eye(3)),
        "pairs": sparse.coo_matrix(np.eye(3)),
        "scalar": np.float64(1.5),
        "text": "lbs",
        "list": [1, [2.5, None]],
        "objects": np.array([np.arange(2), "a"], dtype=object),
    }
    # The highest with buffers of their own is 5; 0 is text.
    return [{"a.pkl": pickle.dumps(arrays, protocol)} for protocol in (0, 2, 4, 5)]


def flame_files() -> list[Case]:
    """A model of few vertices, which is read as a whole and refused for its shapes."""
    arrays: dict[str, Any] = flame_arrays() | {
        "shapedirs": numbers(1, 4, 3, 2),
        "posedirs": numbers(2, 4, 3, 2),
    }
    small = {
        name: value[:4] if isinstance(value, np.ndarray) and len(value) > 9 else value
        for name, value in arrays.items()
    }
    small["J_regressor"] = sparse.csc_matrix(numbers(3, 5, 4))
    dense: dict[str, Any] = {
        name: value.toarray() if hasattr(value, "toarray") else value
        for name, value in small.items()
        if name not in ("bs_style", "bs_type")
    }
    return [
        written(lambda folder: write_flame(folder / "generic_model.pkl", small)),
        written(lambda folder: np.savez(folder / "flame2023.npz", **dense)),
    ]


def whole_flame() -> list[Case]:
    """A model of the published size whose modes are zeros, with the landmarks and UVs that may lie
    beside it.
    """
    arrays: dict[str, Any] = flame_arrays()
    dense = {
        name: np.asarray(arrays[name]) for name in ("v_template", "f", "weights", "kintree_table")
    }
    dense["J_regressor"] = arrays["J_regressor"].toarray()
    dense["v_template"] = dense["v_template"].astype(np.float32)
    dense["weights"] = dense["weights"].astype(np.float16)
    count = len(dense["v_template"])
    dense["shapedirs"] = np.zeros((count, 3, 400), np.float16)
    dense["posedirs"] = np.zeros((count, 3, 36), np.float16)
    points = np.random.default_rng(1).random((count, 2), np.float32)

    def write(folder: Path) -> None:
        write_embedding(folder / "landmark_embedding.npy", embedding())
        np.savez(folder / "FLAME_texture.npz", vt=points, ft=dense["f"].astype(np.int32))

    beside = written(write)
    stream = io.BytesIO()
    np.savez_compressed(stream, **dense)
    return [beside | {"flame2023.npz": stream.getvalue()}]


def bfm_files() -> list[Case]:
    """statismo's HDF5 of a small head."""
    face = head(HEAD_VERTICES, ring=24)
    return [written(lambda folder: write_statismo(folder / "model2019_bfm.h5", face, 2, 1))]


def mat_files() -> list[Case]:
    """MATLAB files of the model of 2009, plain and compressed, that are read as a whole and refused
    for their size.
    """
    arrays = {
        "shapeMU": numbers(1, 30, 1),
        "shapePC": numbers(2, 30, 2),
        "shapeEV": numbers(3, 2, 1),
        "texMU": numbers(4, 30, 1),
        "texPC": numbers(5, 30, 2),
        "texEV": numbers(6, 2, 1),
        "tl": np.arange(1, 7, dtype=np.int32).reshape(2, 3),
        "segbin": sparse.csc_matrix(np.eye(3)),
    }
    more = arrays | {"tl": np.array([["a", 1]], object)}
    made = []
    for content, packed in ((arrays, False), (arrays, True), (more, True)):
        stream = io.BytesIO()
        scipy.io.savemat(stream, content, do_compression=packed)
        # The first 116 bytes say when it was written.
        made.append(
            {"01_MorphableModel.mat": b"MATLAB 5.0 MAT-file".ljust(116) + stream.getvalue()[116:]}
        )
    return made


def gnm_files() -> list[Case]:
    arrays = gnm_arrays(HEAD_VERTICES)
    arrays["pose_correctives_regressor"] = np.zeros_like(arrays["pose_correctives_regressor"])

    def write(folder: Path) -> None:
        write_landmarks(folder / "head_sparse_68.txt", HEAD_VERTICES)

    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return [written(write) | {"gnm_head.npz": stream.getvalue()}]


def ict_files() -> list[Case]:
    """An archive of one shape each, of the right size and of another."""
    random = np.random.default_rng(1)
    lines = [f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in random.uniform(-9, 9, (ICT_VERTICES, 3))]
    lines += ["vt 0.1 0.2", "vt 0.3 0.4", "vt 0.5 0.9"]
    lines += [
        f"f {k % 26000 + 1}/1 {k % 26000 + 2}/2 {k % 26000 + 3}/3 {k % 26000 + 4}/3"
        for k in range(ICT_POLYGONS)
    ]
    marks = json.dumps({"idx_to_landmark_verts": list(range(68))}).encode()
    short = b"v 1 2 3\nv 4 5 6\nvt 0.1 0.2\nf 1/1 2/1 1/1\n"
    top = "ICT/FaceXModel/"

    def members(mesh: bytes) -> list[tuple[str, bytes]]:
        names = ("generic_neutral_mesh.obj", "identity000.obj", "jawOpen.obj")
        return [(top + name, mesh) for name in names] + [(top + "vertex_indices.json", marks)]

    whole = members("\n".join(lines).encode())
    return [
        {"ict.zip": zip_bytes(whole, 8)},
        {"ict.zip": zip_bytes(members(short))},
        {"ict.tar.xz": lzma.compress(tar_bytes(members(short)), preset=0)},
        {"ict.tar.gz": gzip.compress(tar_bytes(members(short)), 1, mtime=0)},
        {f"ict/{name.removeprefix('ICT/')}": data for name, data in members(short)},
    ]


def bombs() -> list[Case]:
    """Small files that unpack, or ask, for more memory than a reader may take."""
    header = io.BytesIO()
    shape = (BOMB << 17,)
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    zeros = lzma.compress(bytes(300 << 20), preset=0)
    top = "ICT/FaceXModel/a.obj"
    info = tarfile.TarInfo(top)
    info.size = 8 * (300 << 20)
    asks = np.lib.format.magic(1, 0)
    return [
        {"ict.zip": bomb_zip(top)},
        {"ict.tar.xz": lzma.compress(info.tobuf(), preset=0) + zeros * 8},
        {"a.npz": bomb_zip("a.npy", header.getvalue())},
        {"a.npz": zip_bytes([("a.npy", header.getvalue())])},
        {"a.npz": zip_bytes([("a.npy", asks + b"\xff\xff" + b" " * 65535)])},
        {"a.pkl": b"\x80\x04r\xff\xff\xff\x0f."},
        {
            "a.pkl": b"\x80\x02]"
            + b"".join(b"q%c0](h%ch%ce" % (k, k, k) for k in range(1, 60))
            + b"."
        },
        {"a.h5": hdf5_of_nothing()},
        {"a.png": large_png(13_300)},
        {"a.png": large_png(16_000)},
        {"a.png": large_png(65_000)},
    ]


def hdf5_of_nothing() -> bytes:
    """statismo's structure of the largest sizes that are read, with nothing stored."""
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for group in ("shape", "color", "expression"):
            for name, shape in (
                ("mean", (750_000,)),
                ("pcaBasis", (750_000, 2000)),
                ("pcaVariance", (2000,)),
            ):
                file.create_dataset(
                    f"{group}/model/{name}", shape, "f4", chunks=True, fillvalue=1.0
                )
        file.create_dataset(
            "shape/representer/cells", (3, 2**33), "i4", chunks=(3, 2**20), fillvalue=1
        )
    return stream.getvalue()


def large_png(side: int) -> bytes:
    """A grey PNG of nothing, ``side`` x ``side``."""
    content = b"\x78\x01" + deflated_zeros(side * (side + 1) >> 20) + bytes(4)
    size = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return PNG + png_chunk(b"IHDR", size) + png_chunk(b"IDAT", content) + png_chunk(b"IEND", b"")


def geometry_messages() -> list[Case]:
    """The protocol buffer of the landmark model's own face: 468 points on a grid that is its own
    mirror image.
    """
    column, row = np.meshgrid(np.arange(18) - 8.5, np.arange(26))
    points = (
        np.stack([column, row, 0 * row, 0 * row, 0 * row], axis=-1).reshape(-1, 5).astype("<f4")
    )
    corner = (np.arange(25)[:, None] * 18 + np.arange(17)).ravel()
    triangles = np.stack([corner, corner + 1, corner + 18], axis=1).ravel()
    mesh = _field(3, points.tobytes()) + b"".join(
        _varint(4 << 3) + _varint(int(value)) for value in triangles
    )
    return [{"geometry.binarypb": _field(1, mesh)}]


def bundles() -> list[Case]:
    members = [("face_detector.tflite", b"TFL3"), ("face_landmarks_detector.tflite", b"TFL3")]
    geometry = geometry_messages()[0]["geometry.binarypb"]
    return [
        {
            "face_landmarker.task": zip_bytes(
                [*members, ("geometry_pipeline_metadata_landmarks.binarypb", geometry)]
            )
        }
    ]


def _varint(value: int) -> bytes:
    code = b""
    while value > 127:
        code += bytes([value & 127 | 128])
        value >>= 7
    return code + bytes([value])


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content
