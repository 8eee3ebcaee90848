"""Pinning: a point of the face is put on its pixel, and the rest of the face follows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER
from facestage.contract.landmarks import Landmarks
from facestage.contract.pins import PIN_SIGMA_SHARE, Pins

from ..landmarks.editing import read_landmarks
from ..landmarks.scheme import handles
from ..pictures.images import load_image
from ..rig.face_rig import move_sliders, require_rig
from ..rig.landmark_points import landmark_points
from ..rig.own_marks import slot_parts
from ..rig.sliders import carrier
from ..scene.camera import camera_pose, read_camera, require_camera
from ..scene.paths import require_photo
from ..scene.several import shares_camera
from .picking import surface_at
from .record import Record, moved_pin, with_pin, without_pin
from .rig_shapes import Slider, current_vertices, read_handles, read_shapes, read_values, sliders_of
from .solver import Guess, Shapes, Sight, energy, positions, solve, upright_pose

# As in the backend: the deviation of a landmark as a share of the face's size, and of how many
# independent points all of them are.
LANDMARK_SIGMA_SHARE, INDEPENDENT = 0.0085, 17.0
HIDDEN_SIGMA = 3.0
FOCAL_SIGMA = 0.25  # of the logarithm of a focal length that is unknown
# A face that nothing says the place of follows its pins as a whole.
LOOSE = 10.0
DRAG_STEPS = 4  # of the solver for each move of the mouse
SAME = 1e-5  # metres, radians, sliders: less is what single floats lose


@dataclass(frozen=True)
class Setting:
    """The scene's rig in its camera, in front of its photo."""

    rig: bpy.types.Object
    camera: bpy.types.Object
    lens: Camera
    sliders: list[Slider]
    # (k,) what the handles of a control rig add to the sliders, and where it and the rig stood
    handles: np.ndarray
    carrier_pose: Matrix
    rig_pose: Matrix
    lens_mm: float

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Setting:
        """Raises InputError when photo, camera or rig are missing."""
        width, height = load_image(require_photo(scene)).size
        camera, rig = require_camera(scene), require_rig(scene)
        for layer in scene.view_layers:
            layer.update()
        sliders = sliders_of(rig)
        return cls(
            rig,
            camera,
            read_camera(camera.data, width, height),
            sliders,
            read_handles(rig, sliders),
            carrier(rig).matrix_world.copy(),
            rig.matrix_world.copy(),
            camera.data.lens,
        )

    def guess(self) -> Guess:
        """How the face stands, through which lens."""
        to_camera = np.linalg.inv(camera_pose(self.camera)) @ np.array(self.rig.matrix_world)
        focal_px = self.lens_now().focal_px
        return Guess(to_camera, read_values(self.rig, self.sliders), focal_px)

    def lens_now(self) -> Camera:
        """The camera's lens as it is by now."""
        return read_camera(self.camera.data, self.lens.width, self.lens.height)

    def show(self, guess: Guess) -> None:
        """Let the face stand so, and the camera have this lens."""
        if guess.focal_px is not None and guess.focal_px != self.lens_now().focal_px:
            self.camera.data.lens = self.lens_mm * guess.focal_px / self.lens.focal_px
        pose = Matrix((camera_pose(self.camera) @ guess.to_camera).tolist())
        moved = carrier(self.rig)
        if moved == self.rig:
            moved.matrix_world = pose
        else:
            moved.matrix_world = pose @ self.rig_pose.inverted() @ self.carrier_pose
        values = zip(self.sliders, (guess.sliders - self.handles).tolist(), strict=True)
        move_sliders(self.rig, {each.name: value for each, value in values})

    def shapes(self, corners: np.ndarray, weights: np.ndarray) -> Shapes:
        """Points of the rig's surface for the solver."""
        return read_shapes(self.rig, self.sliders, corners, weights)

    def pick(self, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """The corners (3,) and weights (3,) of the surface's point that shows at ``pixel``."""
        to_camera = self.guess().to_camera
        points = current_vertices(self.rig) @ to_camera[:3, :3].T + to_camera[:3, 3]
        return surface_at(
            pixel, self.lens_now().project(points), -points[:, 2], shown_triangles(self.rig)
        )


class Pinning:
    """The pins of the scene's photo while they change."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        """Raises InputError when something is missing, or the pins are another rig's."""
        self.scene, self.setting = scene, Setting.of(scene)
        self._stored = scene.facestage.pins
        self.record = Record.of(scene.facestage, self.setting.rig)
        self.start = self.guess = self.setting.guess()
        before, after = self.record.before, self.record.after
        if before is None or after is None or not _same(after, self.guess):
            before = self.guess
        self.before: Guess = before
        _, corners, weights = anchors(self.setting.rig)
        self._anchors = corners, weights
        settings = scene.facestage
        self._loose = 1.0 if settings.result or settings.landmarks else LOOSE
        self._focal_sigma = FOCAL_SIGMA if finds_focal(scene) else 0.0
        self._prepare()

    @property
    def pins(self) -> Pins:
        """As they are."""
        return self.record.pins

    @property
    def shown(self) -> np.ndarray:
        """(p, 2) pixels at which the pinned points of the face show."""
        points = positions(self._shapes, self.guess)[len(self._anchors[0]) :]
        return np.asarray(self._lens(self.guess).project(points))

    @property
    def landmarks(self) -> np.ndarray:
        """(m, 3) where the face's landmarks are in the world."""
        points = positions(self._shapes, self.guess)[: len(self._anchors[0])]
        pose = camera_pose(self.setting.camera)
        return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])

    def nearest(self, pixel: np.ndarray, reach: float) -> int | None:
        """The pin that is nearest to ``pixel``, no further than ``reach``."""
        away = np.linalg.norm(self.pins.points - pixel, axis=1)
        return int(away.argmin()) if len(away) and away.min() <= reach else None

    def grab(self, pixel: np.ndarray, reach: float = 0.0) -> int:
        """The pin at ``pixel``, no further off than ``reach``, or a new one on the face there.

        Raises InputError where there is no face.
        """
        index = self.nearest(pixel, reach)
        if index is not None:
            return index
        found = self.setting.pick(pixel)
        if found is None:
            raise InputError("There is no face under the pointer; take hold of the wireframe.")
        pins = with_pin(self.pins, *found, pixel, PIN_SIGMA_SHARE * self._face_px)
        self.record = replace(self.record, pins=pins)
        self._prepare()
        return len(self.pins) - 1

    def move(self, index: int, pixel: np.ndarray, steps: int = DRAG_STEPS) -> None:
        """Put a pin on a pixel; the face follows, in the scene too."""
        self.record = replace(self.record, pins=moved_pin(self.pins, index, pixel))
        self.settle(steps)

    def remove(self, index: int) -> None:
        """Take a pin away; the face follows."""
        self.record = replace(self.record, pins=without_pin(self.pins, index))
        self._prepare()
        self.settle()

    def settle(self, steps: int | None = None) -> None:
        """Find the face under the pins, by at most so many steps, and show it."""
        if not len(self.pins):
            self.guess = self.before
        else:
            limit = {} if steps is None else {"steps": steps}
            self.guess = solve(
                self._shapes, self._sight(), self.guess, self.before.sliders, **limit
            )
        self.setting.show(self.guess)

    def keep(self) -> None:
        """Have the scene remember the pins."""
        # As the scene holds it, in single floats.
        for layer in self.scene.view_layers:
            layer.update()
        after = self.setting.guess()
        replace(self.record, before=self.before, after=after).store(self.scene.facestage)

    def give_back(self) -> None:
        """Let face and pins be as they were."""
        self.setting.show(self.start)
        self.scene.facestage.pins = self._stored

    def _prepare(self) -> None:
        corners = np.concatenate([self._anchors[0], self.pins.corners])
        weights = np.concatenate([self._anchors[1], self.pins.weights])
        self._shapes = self.setting.shapes(corners, weights)
        count = len(self._anchors[0])
        seen = positions(self._shapes, self.before)[:count]
        self._targets = np.asarray(self._lens(self.before).project(seen))
        self._face_px = face_size(self._targets)

    def _sight(self) -> Sight:
        """The landmarks where they show before the first pin, and the pins."""
        count, pins = len(self._anchors[0]), len(self.pins)
        deviation = np.full(count, self._loose * LANDMARK_SIGMA_SHARE * self._face_px)
        deviation[~np.isfinite(self._targets).all(axis=1)] = np.inf
        return Sight(
            self._lens(self.before if self._focal_sigma else self.guess),
            np.concatenate([np.nan_to_num(self._targets), self.pins.points]),
            np.concatenate([deviation, self.pins.deviation]),
            np.concatenate([np.full(count, INDEPENDENT / count), np.ones(pins)]),
            np.arange(count + pins) >= count,
            self._focal_sigma,
        )

    def _lens(self, guess: Guess) -> Camera:
        focal_px = guess.focal_px or self.setting.lens.focal_px
        return replace(self.setting.lens, focal_px=focal_px)


def finds_focal(scene: bpy.types.Scene) -> bool:
    """Whether pins find the focal length, too: where the lens is unknown, and nothing else shows
    through it.
    """
    settings = scene.facestage
    known = settings.known_lens or settings.keep_camera or "focal" in settings.freeze
    return settings.pin_focal and not known and not shares_camera(scene)


def place_by_landmarks(scene: bpy.types.Scene) -> None:
    """Stand the rig where the photo's landmarks are, with the sliders that they ask for, and the
    focal length where that is unknown.

    Raises InputError when there are none, or something is missing.
    """
    setting = Setting.of(scene)
    landmarks = read_landmarks(scene, setting.lens.width, setting.lens.height)
    if landmarks is None:
        raise InputError("The photo has no landmarks; press Detect Landmarks first.")
    indices, corners, weights = anchors(setting.rig, landmarks.scheme)
    sight = sight_of(landmarks, indices, setting.lens, FOCAL_SIGMA if finds_focal(scene) else 0.0)
    shapes = setting.shapes(corners, weights)
    rest = np.clip(np.zeros(len(setting.sliders)), shapes.low, shapes.high)
    to_camera = upright_pose(shapes.at(rest), sight, np.array(setting.rig.matrix_world.to_scale()))
    start = Guess(to_camera, rest)
    found = solve(shapes, sight, start, rest)
    if not np.isfinite(energy(shapes, sight, found, rest)):
        raise InputError("The landmarks do not show where the face is; mend them first.")
    setting.show(found)


def anchors(rig: bpy.types.Object, scheme: str = "") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The landmarks that hold a rig: indices (m,) in their scheme, vertices and weights (m, 3).

    Raises InputError when it does not say where they lie.
    """
    name, corners, weights = landmark_points(rig, scheme)
    chosen = np.array([each.index for each in handles(name, len(corners))])
    return chosen, corners[chosen], weights[chosen]


def face_size(pixels: np.ndarray) -> float:
    """The longer side of the landmarks' box, pixels."""
    return max(float(np.nanmax(np.ptp(pixels[np.isfinite(pixels).all(axis=1)], axis=0))), 1.0)


def shown_triangles(rig: bpy.types.Object) -> np.ndarray:
    """(t, 3) the triangles that a fit looks at."""
    mesh = rig.data
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    corners, slots = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    mesh.loop_triangles.foreach_get("material_index", slots)
    left_out = [slot for slot, part in enumerate(slot_parts(rig)) if part == OTHER]
    return corners.reshape(-1, 3)[~np.isin(slots, left_out)]


def sight_of(
    landmarks: Landmarks, indices: np.ndarray, lens: Camera, focal_sigma: float = 0.0
) -> Sight:
    """What the landmarks of these ``indices`` (m,) say of where the face is."""
    pixels = landmarks.points[indices]
    deviation = np.full(len(indices), LANDMARK_SIGMA_SHARE * face_size(pixels))
    deviation[~landmarks.visible[indices]] *= HIDDEN_SIGMA
    if landmarks.weights is not None:
        weights = landmarks.weights[indices]
        deviation = np.where(weights > 0, deviation / np.sqrt(np.maximum(weights, 1e-30)), np.inf)
    deviation[~np.isfinite(pixels).all(axis=1)] = np.inf
    share = np.full(len(indices), INDEPENDENT / len(indices))
    sure = np.zeros(len(indices), bool)
    return Sight(lens, np.nan_to_num(pixels), deviation, share, sure, focal_sigma)


def _same(one: Guess, other: Guess) -> bool:
    if one.sliders.shape != other.sliders.shape:
        return False
    focal, before = one.focal_px or 0.0, other.focal_px or 0.0  # older files do not say
    if focal and before and abs(focal - before) > SAME * before:
        return False
    return np.allclose(one.to_camera, other.to_camera, atol=SAME) and np.allclose(
        one.sliders, other.sliders, atol=SAME
    )
