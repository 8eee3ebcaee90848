"""Where MediaPipe's 478 landmarks lie on a face model, from pictures of it: python
tools/derive_landmarks.py --help.

The model is rendered at known shapes and poses, the network looks at the pictures and at their
mirror images, and each landmark becomes the point of the surface that is seen nearest to all its
detections. So the table holds what the network does rather than what its canonical face looks like;
that face, warped smoothly onto the found points, is the check and stands in for points that the
pictures leave open. The results are committed; nobody else needs to run this.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from landmark_pictures import (
    Draw,
    LandmarkNet,
    Photographer,
    canonical_mesh,
    draw_person,
    mirror_order,
)
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from facestage.contract.face_model import EYES, SKIN
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.fit.face.geometry import FaceGeometry
from facestage.models.mesh.surface import closest_weights
from facestage.models.registry import load_model

COUNT, FIRST_IRIS = 478, 468
OUTER_EYE_CORNERS = (36, 45)  # of the 68
# Facing between which an observation starts to count and counts in full: cosine of normal and view.
COSINE_ZERO, COSINE_FULL = 0.1, 0.4
ROBUST_SHARE = 0.03  # of the distance of the outer eye corners
# of all pictures must show a point well, or the warped canonical face places it
SETTLED_SHARE = 0.15
GRID = 10  # subdivisions of a triangle's sides in the search


@dataclass(frozen=True)
class Observations:
    """What the network saw in N pictures; pixels are in shares of the distance of the outer eye
    corners.
    """

    vertices: np.ndarray  # (N, n, 2) where every rendered vertex lies
    cosine: np.ndarray  # (N, n) of normal and view
    found: np.ndarray  # (N, 478, 2)
    open_eyes: np.ndarray  # (N,) bool

    def part(self, which: slice | np.ndarray) -> Observations:
        """Some of the pictures."""
        return Observations(*(getattr(self, name)[which] for name in vars(self)))


def main() -> None:
    """Render, detect, solve, write, and say how well the table predicts pictures that were held
    back.
    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="face_landmarker.task")
    parser.add_argument("--model", default="default", help="default or ict:PATH")
    parser.add_argument("--out", type=Path, required=True, help="the .npz to write")
    parser.add_argument("--pictures", type=int, default=150)
    parser.add_argument(
        "--held-back", type=int, default=50, help="further pictures for the figures alone"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="an .npz that keeps the detections between runs")
    parser.add_argument(
        "--residuals", type=Path, help="an .npz for landmark_scatter.py: where the table is off"
    )
    options = parser.parse_args()
    photographer = Photographer(load_model(options.model))
    geometry = photographer.geometry
    canonical = canonical_mesh(options.bundle)
    count = options.pictures + options.held_back
    people = [
        draw_person(geometry.model, np.random.default_rng([options.seed, number]))
        for number in range(count)
    ]
    found = detections(photographer, people, options.bundle, options.seed, options.keep)
    seen = observe(geometry, people, found)
    train, test = slice(0, 2 * options.pictures), slice(2 * options.pictures, None)
    table = solve(geometry, seen.part(train), canonical)
    residual, cosine = residuals(table, seen)
    distance = 100 * np.linalg.norm(residual, axis=-1)[test][cosine[test] > COSINE_FULL]
    print(
        f"held back: median {np.median(distance):.2f} %, 95 % {np.percentile(distance, 95):.2f} % "
        "of the eye corners"
    )
    positions = _positions(geometry, table)
    table[:, :3] = geometry.used[table[:, :3].astype(int)]
    write_arrays(
        options.out, {"table": table.astype(np.float32), "positions": positions.astype(np.float32)}
    )
    if options.residuals is not None:
        held_back = np.arange(len(residual)) >= 2 * options.pictures
        arrays = {
            "residual": residual,
            "cosine": cosine,
            "held_back": held_back,
            "positions": positions,
        }
        write_arrays(options.residuals, arrays)


def detections(
    photographer: Photographer, people: list[Draw], bundle: Path, seed: int, keep: Path | None
) -> np.ndarray:
    """(2 N, 478, 2) pixels: each picture, and its mirror image mirrored back."""
    if keep is not None and keep.is_file():
        found = read_arrays(keep, "file of detections")["found"]
        if len(found) == 2 * len(people):
            return found
    net, mirror = LandmarkNet(bundle), mirror_order(canonical_mesh(bundle))
    result = []
    for number, person in enumerate(people):
        rng = np.random.default_rng([seed, number, 1])
        picture, outline = photographer.picture(person, rng), photographer.outline(person)
        # A detector's box goes from the chin to the forehead.
        box = np.stack([outline.min(0) - [0, 0.25 * np.ptp(outline[:, 1])], outline.max(0)])
        result.append(net.detect(picture, box, rng))
        width = picture.shape[1]
        turned = np.stack([[width - box[1, 0], box[0, 1]], [width - box[0, 0], box[1, 1]]])
        mirrored = net.detect(np.ascontiguousarray(picture[:, ::-1]), turned, rng)[mirror]
        result.append(np.stack([width - mirrored[:, 0], mirrored[:, 1]], axis=1))
    if keep is not None:
        write_arrays(keep, {"found": np.stack(result)})
    return np.stack(result)


def observe(geometry: FaceGeometry, people: list[Draw], found: np.ndarray) -> Observations:
    """The detections beside the true places of all vertices."""
    corners, weights = geometry.model.landmark_vertices("ibug68")
    eye = list(OUTER_EYE_CORNERS)
    vertices, cosine, units = [], [], []
    for person in people:
        placed = (
            geometry.vertices(person.identity, person.expression) @ person.rotation.T
            + person.translation
        )
        ends = np.einsum("mi,mix->mx", weights[eye], placed[geometry.new_index[corners[eye]]])
        unit = person.camera.focal_px * np.linalg.norm(ends[1] - ends[0]) / -ends[:, 2].mean()
        normals, _ = geometry.vertex_normals(placed)
        facing = -np.einsum("nx,nx->n", normals, placed) / np.linalg.norm(placed, axis=1)
        vertices += 2 * [(person.camera.project(placed) / unit).astype(np.float32)]
        cosine += 2 * [facing.astype(np.float32)]
        units += 2 * [unit]
    open_eyes = np.array([not person.blinks for person in people]).repeat(2)
    return Observations(
        np.stack(vertices), np.stack(cosine), found / np.array(units)[:, None, None], open_eyes
    )


def solve(geometry: FaceGeometry, seen: Observations, canonical: np.ndarray) -> np.ndarray:
    """(478, 6) rendered-vertex indices and barycentric weights, its two sides mirror images."""
    skin = geometry.triangles[geometry.triangle_part == SKIN]
    eyes = geometry.triangles[geometry.triangle_part == EYES]
    # Behind lids and lips nothing is ever seen.
    facing = (seen.cosine > COSINE_ZERO).mean(axis=0) > SETTLED_SHARE
    skin, eyes = (part[facing[part].all(axis=1)] for part in (skin, eyes))
    positions, settled = np.zeros((COUNT, 3)), np.zeros(COUNT, bool)
    for point in range(COUNT):
        use = seen.part(seen.open_eyes) if point >= FIRST_IRIS else seen
        table, share = best_point(eyes if point >= FIRST_IRIS else skin, use, use.found[:, point])
        positions[point], settled[point] = (
            _positions(geometry, table[None])[0],
            share > SETTLED_SHARE,
        )
    mirror = mirror_order(canonical)
    positions = 0.5 * (positions + positions[mirror] * [-1, 1, 1])
    settled &= settled[mirror]
    warped = _warped(canonical, positions[:FIRST_IRIS], settled[:FIRST_IRIS])
    gap = 1e3 * np.linalg.norm(warped - positions[:FIRST_IRIS], axis=1)[settled[:FIRST_IRIS]]
    print(
        f"{(~settled).sum()} points left open; warped canonical face: median {np.median(gap):.2f} "
        f"mm, 95 % {np.percentile(gap, 95):.2f} mm from the others"
    )
    positions[:FIRST_IRIS][~settled[:FIRST_IRIS]] = warped[~settled[:FIRST_IRIS]]
    return np.concatenate(
        [
            nearest_on_mesh(geometry.mean, skin, positions[:FIRST_IRIS]),
            nearest_on_mesh(geometry.mean, eyes, positions[FIRST_IRIS:]),
        ]
    )


def best_point(
    triangles: np.ndarray, seen: Observations, found: np.ndarray
) -> tuple[np.ndarray, float]:
    """Three vertices and weights (6,) of the surface point nearest to ``found`` (N, 2), and how
    often it is seen.
    """
    vertices = np.unique(triangles)
    coarse = _cost(seen.vertices[::4, vertices], seen.cosine[::4, vertices], found[::4])[0]
    vertices = vertices[np.argsort(coarse)[: max(30, len(vertices) // 25)]]
    cost = _cost(seen.vertices[:, vertices], seen.cosine[:, vertices], found)[0]
    best = vertices[np.argsort(cost)[:3]]
    around = triangles[np.isin(triangles, best).any(axis=1)]
    weights = (
        np.array([(i, j, GRID - i - j) for i in range(GRID + 1) for j in range(GRID + 1 - i)])
        / GRID
    )
    tables = np.concatenate(
        [np.repeat(around, len(weights), axis=0), np.tile(weights, (len(around), 1))], axis=1
    )
    corners = tables[:, :3].astype(int)
    at = np.einsum("ki,nkix->nkx", tables[:, 3:], seen.vertices[:, corners], optimize=True)
    cosine = np.einsum("ki,nki->nk", tables[:, 3:], seen.cosine[:, corners], optimize=True)
    cost, share = _cost(at, cosine, found)
    return tables[cost.argmin()], float(share[cost.argmin()])


def _cost(at: np.ndarray, cosine: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k,) robust mean distance of candidates ``at`` (N, k, 2) from ``found`` (N, 2), and their
    mean weight.
    """
    weight = np.clip((cosine - COSINE_ZERO) / (COSINE_FULL - COSINE_ZERO), 0, 1)
    squared = ((at - found[:, None]) ** 2).sum(axis=-1) / ROBUST_SHARE**2
    share = weight.mean(axis=0)
    # A point that is hardly ever seen explains nothing: unseen pictures count as far off, a little.
    return ((weight * np.log1p(squared)).mean(axis=0) + 0.02) / (share + 0.01), share


def _warped(canonical: np.ndarray, positions: np.ndarray, settled: np.ndarray) -> np.ndarray:
    """(468, 3) the canonical face warped by a smooth thin-plate spline onto the settled points."""
    spline = RBFInterpolator(
        canonical[settled], positions[settled], kernel="thin_plate_spline", smoothing=5.0, degree=1
    )
    return spline(canonical)


def nearest_on_mesh(vertices: np.ndarray, triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(m, 6) vertices and barycentric weights of the mesh's points nearest to ``points`` (m, 3)."""
    centre_tree = cKDTree(vertices[triangles].mean(axis=1))
    result = []
    for point in points:
        near = triangles[centre_tree.query(point, min(40, len(triangles)))[1]]
        weights = closest_weights(point, vertices[near])
        distance = np.linalg.norm(np.einsum("ti,tix->tx", weights, vertices[near]) - point, axis=1)
        result.append(np.concatenate([near[distance.argmin()], weights[distance.argmin()]]))
    return np.array(result)


def residuals(table: np.ndarray, seen: Observations) -> tuple[np.ndarray, np.ndarray]:
    """(N, 478, 2) detection minus table point, and the cosine (N, 478) of normal and view, -1
    behind lids.
    """
    corners = table[:, :3].astype(int)
    at = np.einsum("mi,nmix->nmx", table[:, 3:], seen.vertices[:, corners], optimize=True)
    cosine = np.einsum("mi,nmi->nm", table[:, 3:], seen.cosine[:, corners], optimize=True)
    cosine[~seen.open_eyes, FIRST_IRIS:] = -1.0
    return (seen.found - at).astype(np.float32), cosine.astype(np.float32)


def _positions(geometry: FaceGeometry, table: np.ndarray) -> np.ndarray:
    return np.einsum("mi,mix->mx", table[:, 3:], geometry.mean[table[:, :3].astype(int)])


if __name__ == "__main__":
    main()
