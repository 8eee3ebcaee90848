"""How much of a scan's fine relief a fit found: its normals with and without its normal map, and
its height map in a band of wavelengths, against the scan's own normal map.

python tools/score_relief.py CASE [RESULT...] --scan head.obj --scan-normal normal.jpg
    [--scan-color color.jpg] [--face-region FILE.npy] [--band 1 5]

A CASE is a folder with scan.npz, made by ``facestage_blender.cases --scan`` from the same two files
(docs/scans.md); a RESULT is a folder of ``facestage fit`` of its photo. ``--scan-color`` asks
besides what no fit can pass: how much of the photo's own detail is the scan's relief.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.sparse.linalg import splu

from facestage.contract.camera import Camera
from facestage.contract.case_files import CAMERA, LINEAR_PHOTO, SCAN
from facestage.contract.errors import InputError
from facestage.contract.files.color import srgb_to_linear
from facestage.contract.result import Result
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.fit.forward.rendering import face_pixels
from facestage.fit.forward.shading import pixel_rays, sample_bilinear
from facestage.fit.forward.surface_frame import FrameField
from facestage.fit.result.relight import prepared
from facestage.images.image_io import read_exr
from facestage.models.mesh.similarity import procrustes
from facestage.models.mesh.surface import vertex_normals
from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer

STRENGTH = 0.8  # of the normal map in the photographs that the cases take
FACING = 0.3  # cosine between view and true normal, below which a pixel is left out
WIDTH = 1 / 6  # of a wavelength, the Gaussian that lets it pass, about
SHADOWED = 0.35  # share of the face's pixels, the darkest, that say nothing of the light
STEP = 4.0  # times the usual distance of neighbours on the skin, beyond which there is a step


@dataclass(frozen=True)
class Mapped:
    """A mesh's triangles with texture coordinates, and the normal map that lies over them."""

    triangles: np.ndarray  # (t, 3)
    uvs: np.ndarray  # (t, 3 corners, 2)
    normal_map: np.ndarray  # (S, S, 3), 0 to 1, in tangent space

    def normals(
        self, vertices: np.ndarray, triangle: np.ndarray, weights: np.ndarray, strength: float
    ) -> np.ndarray:
        """(p, 3) unit normals at points of the triangles (p,) with barycentric weights (p, 3)."""
        smooth = vertex_normals(vertices, self.triangles)
        normal = np.einsum("pi,pix->px", weights, smooth[self.triangles[triangle]])
        normal = _unit(normal)
        corners, flat = vertices[self.triangles[triangle]], self.uvs[triangle]
        side, across = corners[:, 1:] - corners[:, :1], flat[:, 1:] - flat[:, :1]
        area = across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0]
        sign = np.sign(area)[:, None]
        by_u = sign * (across[:, 1, 1, None] * side[:, 0] - across[:, 0, 1, None] * side[:, 1])
        tangent = _unit(by_u - normal * (normal * by_u).sum(axis=1, keepdims=True))
        uvs = np.einsum("pi,pix->px", weights, flat)
        x, y, z = (2 * sample_bilinear(self.normal_map, uvs) - 1).T[..., None]
        bitangent = sign * np.cross(normal, tangent)
        bent = strength * (x * tangent + y * bitangent + (z - 1) * normal)
        return _unit(normal + bent)


def read_mapped(obj: Path, normal_map: Path) -> tuple[Mapped, int]:
    """The triangles of an OBJ under a normal map, and how many vertices it has.

    Raises InputError.
    """
    count, places, faces = 0, [], []
    for line in obj.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            count += 1
        elif words[:1] == ["vt"]:
            places.append([float(word) for word in words[1:3]])
        elif words[:1] == ["f"]:
            corners = [[int(part) - 1 for part in word.split("/")[:2]] for word in words[1:]]
            if any(len(corner) < 2 for corner in corners):
                raise InputError(f"The scan '{obj}' has faces without texture coordinates (vt).")
            faces += [(corners[0], a, b) for a, b in pairwise(corners[1:])]
    if not faces:
        raise InputError(f"The scan '{obj}' has no faces; expected an OBJ file.")
    index = np.array(faces)
    return Mapped(index[..., 0], np.array(places)[index[..., 1]], _picture(normal_map)), count


@dataclass(frozen=True)
class Found:
    """What pixels that see both faces show; mm and the camera's frame, the fit turned onto the
    truth.
    """

    column: np.ndarray  # (p,)
    row: np.ndarray  # (p,)
    points: np.ndarray  # (p, 3) of the true face
    smooth: np.ndarray  # (p, 3) unit normals of its mesh
    true: np.ndarray  # (p, 3) with its normal map
    mesh: np.ndarray  # (p, 3) of the fitted mesh
    mapped: np.ndarray  # (p, 3) with its normal map, else the same
    height: np.ndarray | None  # (p,) of the fitted height map


@dataclass(frozen=True)
class Shown:
    """What pixels show of a scan's face; p of those that were asked for, in the camera's frame."""

    kept: np.ndarray  # bool, of the pixels that were asked for: those that show it
    points: np.ndarray  # (p, 3) m
    smooth: np.ndarray  # (p, 3) unit normals of the mesh
    true: np.ndarray  # (p, 3) with the normal map
    uvs: np.ndarray  # (p, 2)


def shown(scan: Scan, truth: Mapped, rays: np.ndarray) -> Shown:
    """What rays (q, 3) from the camera see of the face, where it does not graze."""
    vertices = scan.vertices / MILLIMETRES
    middle = vertices.mean(axis=0)
    tracer = RayTracer(truth.triangles, len(vertices))
    tracer.update(vertices - middle)
    hits = tracer.first_hits(-middle, rays)
    face = np.zeros(len(vertices), bool)
    face[scan.face] = True
    kept = (hits.triangle >= 0) & face[truth.triangles].all(axis=1)[hits.triangle]

    def seen(which: np.ndarray) -> tuple[np.ndarray, ...]:
        triangle, weights = hits.triangle[which], hits.barycentric[which].astype(np.float64)
        mesh, whole = (
            truth.normals(vertices, triangle, weights, strength) for strength in (0.0, STRENGTH)
        )
        points = np.einsum("pi,pix->px", weights, vertices[truth.triangles[triangle]])
        return points, mesh, whole, np.einsum("pi,pix->px", weights, truth.uvs[triangle])

    kept[kept] = -(seen(kept)[2] * rays[kept]).sum(axis=1) > FACING
    return Shown(kept, *seen(kept))


def found(result: Result, scan: Scan, truth: Mapped) -> Found:
    """What the pixels of the photo show of the scan's face and of the fitted one."""
    forward, state, _, textures = prepared(result, np.ones(len(result.stage), bool))
    pixels = face_pixels(forward, state) + 0.5
    surface = forward.surface(state, pixels, only_fitted=True)
    face = shown(scan, truth, surface.rays)
    surface = surface.part(face.kept)
    # Of one pixel both see about the same point.
    turn = procrustes(surface.points, face.points).rotation
    mapped, height = surface.normals, None
    if textures.normal is not None and textures.height is not None:
        frames = FrameField.of(forward.geometry, surface.model_vertices)
        uvs = forward.uvs(surface)
        mapped = frames.mapped(surface, uvs, textures.normal, state.rotation).normals
        height = sample_bilinear(textures.height, uvs)
    column, row = surface.pixels.astype(int).T
    return Found(
        column,
        row,
        MILLIMETRES * face.points,
        face.smooth,
        face.true,
        surface.normals @ turn.T,
        mapped @ turn.T,
        height,
    )


def limits(
    case: Path, scan: Scan, truth: Mapped, color: Path, band: Sequence[float]
) -> dict[str, float]:
    """What the scan's own color and relief explain of the photo in the ``band``, with the light
    that explains its smooth normals best: a constant and a direction.
    """
    start_renderer("auto")
    camera = Camera.from_json(json.loads((case / CAMERA).read_text(encoding="utf-8")))
    row, column = (each.ravel() for each in np.mgrid[: camera.height, : camera.width])
    rays = pixel_rays(camera, np.stack([column, row], axis=1) + 0.5)
    face = shown(scan, truth, rays)
    column, row = column[face.kept], row[face.kept]
    red = np.maximum(read_exr(case / LINEAR_PHOTO)[row, column, 0], 1e-4)
    albedo = np.maximum(sample_bilinear(srgb_to_linear(_picture(color)), face.uvs)[:, 0], 0.02)
    light = red / albedo
    # A plane in the normals says nothing of what lies in shadow.
    lit = light > np.quantile(light, SHADOWED)
    design = np.column_stack([np.ones(len(light)), face.smooth])
    by_normal = np.linalg.lstsq(design[lit], light[lit], rcond=None)[0]

    def shade(normals: np.ndarray) -> np.ndarray:
        return np.log(np.maximum(by_normal[0] + normals @ by_normal[1:], 0.1 * light.mean()))

    lattice = Lattice(column, row, MILLIMETRES * face.points)
    bands = [
        lattice.band(values, *band)[lit]
        for values in (np.log(red), np.log(albedo), shade(face.true) - shade(face.smooth))
    ]
    return {"pixel_mm": lattice.spacing} | explained(*bands)


def explained(photo: np.ndarray, color: np.ndarray, shade: np.ndarray) -> dict[str, float]:
    """Shares of a photo's variance that two known causes explain, each (p,): the color, the relief
    beside it, the relief's gain (1: as on matte skin), and the correlation of the shade with what
    the true color leaves of the photo.
    """
    usual = np.abs(photo) < np.quantile(np.abs(photo), 0.98)
    photo, color, shade = photo[usual], color[usual], shade[usual]
    both = np.column_stack([color, shade])
    alone, gains = (np.linalg.lstsq(x, photo, rcond=None)[0] for x in (both[:, :1], both))
    total, left = (photo**2).sum(), photo - both[:, :1] @ alone
    by_color = 1 - (left**2).sum() / total
    by_both = 1 - ((photo - both @ gains) ** 2).sum() / total
    return {
        "by_color": float(by_color),
        "by_relief": float(by_both - by_color),
        "relief_gain": float(gains[1]),
        "relief_correlation": correlation(left, shade),
    }


def degrees(a: np.ndarray, b: np.ndarray) -> float:
    """Mean angle between unit normals (p, 3)."""
    return float(np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1))).mean())


class Lattice:
    """Pixels that are neighbours on the skin."""

    def __init__(self, column: np.ndarray, row: np.ndarray, points: np.ndarray) -> None:
        """``column`` and ``row`` (p,) of the pixels; ``points`` (p, 3) mm, what they see."""
        self._at = row - row.min(), column - column.min()
        numbers = np.full((self._at[0].max() + 1, self._at[1].max() + 1), -1)
        numbers[self._at] = np.arange(len(points))
        self._known = numbers >= 0
        pairs = [
            np.stack([a[(a >= 0) & (b >= 0)], b[(a >= 0) & (b >= 0)]])
            for a, b in ((numbers[:, :-1], numbers[:, 1:]), (numbers[:-1], numbers[1:]))
        ]
        first, second = np.concatenate(pairs, axis=1)
        length = np.linalg.norm(points[second] - points[first], axis=1)
        near = length < STEP * np.median(length)
        self.spacing = float(np.median(length))
        self._first, self._second = first[near], second[near]
        self._way = points[self._second] - points[self._first]

    def height(self, base: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(p,) mm over a surface of normals ``base`` (p, 3), the height by which its normals would
        be ``normals``: least squares over all pairs of neighbours.
        """
        slope = base - normals / np.maximum((base * normals).sum(axis=1, keepdims=True), 0.1)
        rise = (0.5 * (slope[self._first] + slope[self._second]) * self._way).sum(axis=1)
        count, pairs = len(base), np.arange(len(rise))
        difference = sp.csr_matrix(
            (
                np.concatenate([-np.ones(len(pairs)), np.ones(len(pairs))]),
                (np.concatenate([pairs, pairs]), np.concatenate([self._first, self._second])),
            ),
            shape=(len(pairs), count),
        )
        system = difference.T @ difference + 1e-6 * sp.identity(count)
        return np.asarray(splu(sp.csc_matrix(system)).solve(difference.T @ rise))

    def band(self, values: np.ndarray, shortest: float, longest: float) -> np.ndarray:
        """(p,) what ``values`` (p,) have in wavelengths of so many mm."""
        picture = np.zeros(self._known.shape)
        picture[self._at] = values

        def smooth(wavelength: float) -> np.ndarray:
            width = WIDTH * wavelength / self.spacing
            known = gaussian_filter(self._known.astype(float), width)
            return np.asarray(gaussian_filter(picture, width) / np.maximum(known, 1e-9))

        return np.asarray((smooth(shortest) - smooth(longest))[self._at])


def scores(seen: Found, band: Sequence[float]) -> dict[str, float]:
    """Angles in degrees; the heights' correlation in the ``band`` (two wavelengths in mm) and their
    root mean squares there, in mm.
    """
    result = {
        "mesh_normal_degrees": degrees(seen.mesh, seen.true),
        "normal_degrees": degrees(seen.mapped, seen.true),
        # What a perfect map on this mesh would come to.
        "true_relief_degrees": degrees(_unit(seen.mesh + seen.true - seen.smooth), seen.true),
    }
    lattice = Lattice(seen.column, seen.row, seen.points)
    true = lattice.band(lattice.height(seen.mesh, seen.true), *band)
    result |= {"pixel_mm": lattice.spacing, "true_mm": float(true.std())}
    if seen.height is not None:
        own = lattice.band(seen.height, *band)
        result |= {"found_mm": float(own.std()), "correlation": correlation(own, true)}
    return result


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two rows of numbers; 0 where one of them is flat."""
    a, b = a - a.mean(), b - b.mean()
    return float((a @ b) / max(np.sqrt((a @ a) * (b @ b)), 1e-30))


def main() -> None:
    """Print a line for each result."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case", type=Path)
    parser.add_argument("results", type=Path, nargs="*")
    parser.add_argument("--scan", type=Path, required=True, metavar="FILE.obj")
    parser.add_argument("--scan-normal", type=Path, required=True, metavar="FILE")
    parser.add_argument("--scan-color", type=Path, metavar="FILE")
    parser.add_argument("--face-region", type=Path, metavar="FILE.npy")
    parser.add_argument("--band", type=float, nargs=2, default=(1.0, 5.0), metavar="MM")
    options = parser.parse_args()
    scan = Scan.load(options.case / SCAN, options.face_region)
    truth, count = read_mapped(options.scan, options.scan_normal)
    if count != len(scan.vertices):
        parser.error(f"{options.scan} has {count} vertices, the case {len(scan.vertices)}")
    if options.scan_color is not None:
        _tell(options.case, limits(options.case, scan, truth, options.scan_color, options.band))
    for folder in options.results:
        _tell(folder, scores(found(Result.load(folder), scan, truth), options.band))


def _tell(folder: Path, row: Mapping[str, float]) -> None:
    print(folder, *(f"{name} {value:.3f}" for name, value in row.items()), flush=True)


def _picture(path: Path) -> np.ndarray:
    """(h, w, 3) code values, 0 to 1."""
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / 255


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


if __name__ == "__main__":
    main()
