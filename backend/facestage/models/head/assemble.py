"""Puts the neutral head together: skin, eyeballs, mouth bag and teeth in one mesh with one UV
atlas.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix

from facestage.contract.face_model import EYES, MOUTH, SKIN, TEETH
from facestage.models.head import ear, eyes, mouth, topology
from facestage.models.head import teeth as dental
from facestage.models.head.base_surface import LEVELS, BaseSurface
from facestage.models.head.features import EYE_CENTER, EYE_RADIUS, add_features
from facestage.models.head.topology import LEVEL_LINES, STATION_LINES, WINDOWS, MeshBuilder

SIDES = ("left", "right")
_SKIN_V = (0.115, 0.995)  # band of the atlas that the skin fills; the rest lies below
_SKIN_U = (0.005, 0.995)


@dataclass(frozen=True)
class HeadMesh:
    """The neutral head.

    Positions in mm in the frame of the control net; index tables of its structured pieces.
    """

    vertices: np.ndarray  # (n, 3)
    polygons: np.ndarray  # (p, 4) int32, -1 in the fourth place for triangles
    polygon_uvs: np.ndarray  # (p, 4) int32
    polygon_part: np.ndarray  # (p,) uint8
    uvs: np.ndarray  # (u, 2) in 0..1
    chart: np.ndarray  # (n, 2) station and level of skin vertices, NaN elsewhere
    grid: np.ndarray  # (rows, columns) vertex indices, -1 inside windows
    # window name -> (rings, n) vertex indices, the window border first
    loops: dict[str, np.ndarray]
    # (rings, n) vertex indices of the mouth bag, without the border it shares with the lips
    bag: np.ndarray
    eyeballs: dict[str, np.ndarray]  # side -> (m,) vertex indices
    teeth: dict[str, np.ndarray]  # "upper", "lower" -> (m,) vertex indices
    tongue: np.ndarray  # (m,) vertex indices

    @property
    def triangles(self) -> np.ndarray:
        """(t, 3) vertex indices."""
        first, second = (
            self.polygons[:, [0, 1, 2]],
            self.polygons[self.polygons[:, 3] >= 0][:, [0, 2, 3]],
        )
        return np.concatenate([first, second])


def assemble() -> HeadMesh:
    """The neutral head mesh. Deterministic."""
    surface = BaseSurface()
    builder = MeshBuilder()
    station, level = np.meshgrid(STATION_LINES, LEVEL_LINES)
    positions = add_features(surface.point(station.ravel(), level.ravel())).reshape(
        *station.shape, 3
    )
    crown = surface.point(np.zeros(1), np.full(1, float(LEVELS)))[0]
    grid, grid_uv = topology.grid_quads(builder, positions, crown, SKIN)
    patches, bag_positions = _patches(surface)
    loops: dict[str, np.ndarray] = {}
    for name, patch in patches.items():
        loops[name] = _add_patch(builder, name, patch, grid, grid_uv)
    chart_uvs = np.concatenate(builder.uvs)
    skin_uv_count = builder.uv_count
    bag = _add_bag(builder, loops["mouth"][-1], bag_positions)
    eyeballs = {side: _add_eyeball(builder, side) for side in SIDES}
    teeth = {row: _add_teeth(builder, row) for row in ("upper", "lower")}
    tongue = _add_tongue(builder)
    vertices, polygons, polygon_uvs, parts, uvs = builder.arrays()
    vertices = _faired(vertices, polygons[parts == SKIN], grid, loops)
    uvs[:skin_uv_count] = _Atlas(surface).uv(chart_uvs)
    chart = np.full((len(vertices), 2), np.nan)
    skin = parts == SKIN
    corner_used = polygons[skin] >= 0
    chart[polygons[skin][corner_used]] = chart_uvs[polygon_uvs[skin][corner_used]]
    return HeadMesh(
        vertices,
        polygons,
        polygon_uvs,
        parts,
        uvs,
        chart,
        grid,
        loops,
        bag,
        eyeballs,
        teeth,
        tongue,
    )


def _faired(
    vertices: np.ndarray, polygons: np.ndarray, grid: np.ndarray, loops: dict[str, np.ndarray]
) -> np.ndarray:
    """Vertices with the nose and the corners of the windows smoothed; lids, lips and ears stay."""
    n = len(vertices)
    following = np.where(polygons[:, [1, 2, 3, 0]] < 0, polygons[:, :1], polygons[:, [1, 2, 3, 0]])
    edges = np.stack([polygons, following], axis=-1)[polygons >= 0].reshape(-1, 2)
    links = coo_matrix((np.ones(len(edges)), edges.T), (n, n)).tocsr()
    links = ((links + links.T) > 0).astype(np.float64)
    degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1.0)
    free = np.zeros(n)
    free[grid[1:-6][grid[1:-6] >= 0]] = 1.0
    free[loops["mouth"][1 : len(mouth.OUTER_LOOPS)]] = 1.0
    for side in SIDES:
        free[loops[f"eye_{side}"][1:3]] = 1.0
        free[loops[f"ear_{side}"][0]] = 0.0
    nose = np.array([[-14.0, -45.0, 100.0], [14.0, -45.0, 100.0]])
    near_nose = np.exp(-(((vertices[:, None] - nose) / [11.0, 10.0, 18.0]) ** 2).sum(axis=2)).max(
        axis=1
    )
    corner = np.array([[-31.0, -73.0, 80.0], [31.0, -73.0, 80.0]])
    near_corner = np.exp(
        -(((vertices[:, None] - corner) / [8.0, 10.0, 14.0]) ** 2).sum(axis=2)
    ).max(axis=1)
    weight = free * (0.12 + 0.38 * near_nose + 0.25 * near_corner)
    for _ in range(4):
        vertices = vertices + weight[:, None] * ((links @ vertices) / degree[:, None] - vertices)
    return vertices


def window_chart(name: str) -> np.ndarray:
    """(n, 2) chart points (station, level) of a window's border."""
    column, row = WINDOWS[name].loop().T
    return np.stack([STATION_LINES[column], LEVEL_LINES[row]], axis=-1)


def _patches(surface: BaseSurface) -> tuple[dict[str, eyes.Patch], np.ndarray]:
    lips, bag = mouth.lip_patch(surface, window_chart("mouth"))
    lids = eyes.lid_patch(surface, window_chart("eye_left"))
    shell = ear.ear_patch(surface, window_chart("ear_left"))
    patches = {"eye_left": lids, "eye_right": eyes.mirrored(lids), "mouth": lips}
    return patches | {"ear_left": shell, "ear_right": eyes.mirrored(shell)}, bag


def _add_patch(
    builder: MeshBuilder, name: str, patch: eyes.Patch, grid: np.ndarray, grid_uv: np.ndarray
) -> np.ndarray:
    """Loops of vertex indices, the window border first."""
    column, row = WINDOWS[name].loop().T
    shape = patch.positions.shape[:2]
    vertex = np.concatenate(
        [
            grid[row, column][None],
            builder.add_vertices(patch.positions.reshape(-1, 3)).reshape(shape),
        ]
    )
    uv = np.concatenate(
        [grid_uv[row, column][None], builder.add_uvs(patch.chart.reshape(-1, 2)).reshape(shape)]
    )
    builder.add_polygons(topology.ring_quads(vertex), topology.ring_quads(uv), SKIN)
    if name.startswith("ear"):
        builder.add_polygons(topology.cap_quads(vertex[-1]), topology.cap_quads(uv[-1]), SKIN)
    return vertex


def _add_bag(builder: MeshBuilder, border: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """The mouth bag behind the inmost loop of the lips; its UVs are a disc of their own."""
    rings, n = positions.shape[:2]
    index = builder.add_vertices(positions.reshape(-1, 3)).reshape(rings, n)
    vertex = np.concatenate([border[None], index])
    angle = np.pi + 2 * np.pi * np.arange(n) / n
    radius = np.linspace(0.048, 0.006, rings + 1)[:, None]
    disc = np.stack([0.32 + radius * np.cos(angle), 0.055 + radius * np.sin(angle)], axis=-1)
    uv = builder.add_uvs(disc.reshape(-1, 2)).reshape(rings + 1, n)
    builder.add_polygons(topology.ring_quads(vertex), topology.ring_quads(uv), MOUTH)
    builder.add_polygons(topology.cap_quads(vertex[-1]), topology.cap_quads(uv[-1]), MOUTH)
    return index


def _add_eyeball(builder: MeshBuilder, side: str) -> np.ndarray:
    """An eyeball in place; its UVs are a disc with the pupil in the middle."""
    sign = 1.0 if side == "left" else -1.0
    points, polar = eyes.eyeball()
    rows, n = points.shape[:2]
    center = EYE_CENTER * [sign, 1, 1]
    ring = builder.add_vertices((points + center).reshape(-1, 3)).reshape(rows, n)
    poles = builder.add_vertices(
        center + np.array([[0.0, 0.0, EYE_RADIUS], [0.0, 0.0, -EYE_RADIUS]])
    )
    middle = np.array([0.06 if side == "left" else 0.17, 0.055])
    angle = 2 * np.pi * np.arange(n) / n
    disc = (0.05 * polar / np.pi)[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ring_uv = builder.add_uvs((middle + disc).reshape(-1, 2)).reshape(rows, n)
    builder.add_polygons(topology.ring_quads(ring[::-1]), topology.ring_quads(ring_uv[::-1]), EYES)
    front_uv = builder.add_uvs(middle[None])[0]
    # The pole behind is as many UV points as segments: the outer border of the disc.
    behind_angle = angle + np.pi / n
    behind = middle + 0.05 * np.stack([np.cos(behind_angle), np.sin(behind_angle)], axis=-1)
    behind_uv = builder.add_uvs(behind)
    following = np.roll(np.arange(n), -1)
    absent = np.full(n, -1)
    front = np.stack([ring[0], ring[0][following], np.full(n, poles[0]), absent], axis=-1)
    front_t = np.stack([ring_uv[0], ring_uv[0][following], np.full(n, front_uv), absent], axis=-1)
    back = np.stack([ring[-1][following], ring[-1], np.full(n, poles[1]), absent], axis=-1)
    back_t = np.stack([ring_uv[-1][following], ring_uv[-1], behind_uv, absent], axis=-1)
    builder.add_polygons(np.concatenate([front, back]), np.concatenate([front_t, back_t]), EYES)
    return np.concatenate([ring.ravel(), poles])


def _add_teeth(builder: MeshBuilder, row: str) -> np.ndarray:
    strip, _ = dental.strip(dental.UPPER if row == "upper" else dental.LOWER)
    profile, m = strip.shape[:2]
    index = builder.add_vertices(strip.reshape(-1, 3)).reshape(profile, m)
    left, bottom = (0.40, 0.008) if row == "upper" else (0.70, 0.008)
    u, v = np.meshgrid(
        left + 0.28 * np.arange(m) / (m - 1), bottom + 0.09 * np.arange(profile) / (profile - 1)
    )
    v = v if row == "lower" else v[::-1]
    uv = builder.add_uvs(np.stack([u.ravel(), v.ravel()], axis=-1)).reshape(profile, m)

    def quads(table: np.ndarray) -> np.ndarray:
        # Down the front and up the back: the outside is on the left of the strip for the upper row.
        corners = [table[:-1, :-1], table[1:, :-1], table[1:, 1:], table[:-1, 1:]]
        return np.stack(corners if row == "upper" else corners[::-1], axis=-1).reshape(-1, 4)

    builder.add_polygons(quads(index), quads(uv), TEETH)
    return index.ravel()


def _add_tongue(builder: MeshBuilder) -> np.ndarray:
    """The tongue, its tip closed and its root open towards the throat; its UVs are a disc."""
    rings = mouth.tongue()
    rows, n = rings.shape[:2]
    index = builder.add_vertices(rings.reshape(-1, 3)).reshape(rows, n)
    angle = 2 * np.pi * np.arange(n) / n
    radius = np.linspace(0.015, 0.003, rows)[:, None]
    disc = np.stack([0.245 + radius * np.cos(angle), 0.055 + radius * np.sin(angle)], axis=-1)
    uv = builder.add_uvs(disc.reshape(-1, 2)).reshape(rows, n)
    builder.add_polygons(topology.ring_quads(index), topology.ring_quads(uv), MOUTH)
    builder.add_polygons(topology.cap_quads(index[-1]), topology.cap_quads(uv[-1]), MOUTH)
    return index.ravel()


class _Atlas:
    """Monotone maps from station to u and from level to v, nearly true to length on the face."""

    def __init__(self, surface: BaseSurface) -> None:
        station = np.linspace(-10, 10, 401)
        length = np.zeros(401)
        for level in (8.0, 11.0, 15.0, 18.0, 20.0):
            points = surface.point(station, np.full(401, level))
            length[1:] += np.linalg.norm(np.diff(points, axis=0), axis=1)
        # The back of the head gets less room than its length.
        middle = 0.5 * (station[1:] + station[:-1])
        length[1:] *= np.where(np.abs(middle) > 7.5, 0.55, 1.0)
        self._station, self._u = station, np.cumsum(length) / length.sum()
        level_line = np.linspace(0, LEVELS, 401)
        height = np.zeros(401)
        for at in (1.0, 3.0, 5.0):
            points = surface.point(np.full(401, at), level_line)
            height[1:] += np.linalg.norm(np.diff(points, axis=0), axis=1)
        middle = 0.5 * (level_line[1:] + level_line[:-1])
        height[1:] *= np.where((middle > 22) | (middle < 3), 0.6, 1.0)
        self._level, self._v = level_line, np.cumsum(height) / height.sum()

    def uv(self, chart: np.ndarray) -> np.ndarray:
        """(m, 2) atlas points of chart points (m, 2)."""
        u = np.interp(chart[:, 0], self._station, self._u)
        v = np.interp(chart[:, 1], self._level, self._v)
        return np.stack(
            [
                _SKIN_U[0] + (_SKIN_U[1] - _SKIN_U[0]) * u,
                _SKIN_V[0] + (_SKIN_V[1] - _SKIN_V[0]) * v,
            ],
            axis=-1,
        )
