"""Which vertices of a scan's face its photographs show: not those in nostrils, between lips and
behind lids, which no fit of them can know.

python tools/seen_by_photos.py CASE [CASE...] --out seen.npy [--face-region FILE.npy]

A CASE is a folder with scan.npz (docs/scans.md); of several, all of one scan, a vertex counts that
one of them shows. What is written is a region as ``--face-region`` takes it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Bool
from facestage.contract.case_files import SCAN
from facestage.contract.errors import InputError
from facestage.contract.files.atomic import atomic_file
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer

# Millimetres that what is seen first may lie before a vertex: rounding, and its own triangles.
BEFORE_MM = 0.5


def seen(scan: Scan) -> Bool[np.ndarray, " face"]:
    """Which of the scan's face vertices nothing hides from the camera."""
    places = scan.vertices / MILLIMETRES
    tracer = RayTracer(scan.triangles, len(places))
    tracer.update(places)
    face = places[scan.face]
    far = np.linalg.norm(face, axis=1)
    hits = tracer.first_hits(np.zeros(3), face / far[:, None])
    corners = places[scan.triangles[hits.triangle]]
    first = np.linalg.norm(np.einsum("pk,pkx->px", hits.barycentric, corners), axis=1)
    return (hits.triangle < 0) | (first > far - BEFORE_MM / MILLIMETRES)


def seen_region(cases: Sequence[Path], region: Path | None) -> np.ndarray:
    """(f,) numbers of the face's vertices that one of ``cases`` shows. Raises InputError."""
    scans = [Scan.load(case / SCAN, region) for case in cases]
    for case, scan in zip(cases, scans, strict=True):
        if not np.array_equal(scan.face, scans[0].face):
            raise InputError(
                f"The scan of '{case}' has another face than '{cases[0]}'; give one scan."
            )
    return scans[0].face[np.any([seen(scan) for scan in scans], axis=0)]


def main() -> None:
    """Write the region, and say how large it is."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", type=Path, nargs="+", metavar="CASE")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.npy")
    parser.add_argument("--face-region", type=Path, metavar="FILE.npy")
    options = parser.parse_args()
    try:
        start_renderer("cpu")
        region = seen_region(options.cases, options.face_region)
        with atomic_file(options.out) as temporary, temporary.open("wb") as stream:
            np.save(stream, region)
    except InputError as error:
        print(f"seen_by_photos: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    count = len(Scan.load(options.cases[0] / SCAN, options.face_region).face)
    print(f"{len(region)} of {count} vertices of the face are seen")


if __name__ == "__main__":
    main()
