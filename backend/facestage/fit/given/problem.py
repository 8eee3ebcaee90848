"""From a job to everything a fit works on, checked: photo, camera, landmarks, model, lights."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from facestage.contract.camera import FOCAL_MAX, FOCAL_MIN, Camera
from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.face_model import SKIN, FaceModel
from facestage.contract.files.storage import finite
from facestage.contract.grey import color_of_grey
from facestage.contract.job import AUTO, FULL, KNOWN, Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import (
    FROZEN,
    LIGHT_ARRAYS,
    OFF,
    ON,
    LightStage,
    fibonacci_stage,
    joined,
)
from facestage.contract.pins import Pins
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import CHANNELS, LightParameters
from facestage.fit.face.unknowns import FOCAL_SIGMA, kept_shapes
from facestage.fit.given.beard import Beard, beard_of
from facestage.fit.given.black_and_white import as_seen_in_color
from facestage.fit.given.detection import known_to, with_landmarks
from facestage.fit.given.face_areas import face_pixels, face_size_px
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.lash_depth import lash_depth
from facestage.fit.given.metrics import white_level
from facestage.fit.given.photo import Photo
from facestage.fit.given.skin_mask import clear_of_others, paint_weight, skin_weight
from facestage.fit.given.spectacles import clear_of_frame, spectacle_frame
from facestage.fit.given.sunglasses import sunglasses
from facestage.fit.given.teeth import closed_teeth, teeth_color
from facestage.fit.given.window import Window
from facestage.images.image_io import Photograph, read_photograph, resize
from facestage.models.registry import load_model

# Longer side of the bounding box from chin to brows, pixels, at which the face is fitted: finer
# adds cost, not shape.
FINE_FACE_PX, COARSE_FACE_PX = 160.0, 64.0
# A doll's head and a statue's, in metres.
MODEL_SIZE_MIN, MODEL_SIZE_MAX = 0.01, 10.0
# Share of the UV square that the face's skin must cover, about: less is not a texel of most
# textures.
UV_AREA_MIN = 1e-4
FOCAL = "focal_px"  # a starting value: of the photo's pixels


@dataclass(frozen=True)
class Problem:
    """A job with its files read.

    Arrays, camera and landmarks are those of the photo's ``window``.
    """

    job: Job
    photograph: Photograph
    camera: Camera
    landmarks: Landmarks  # the job's, in a scheme that the face model knows
    geometry: FaceGeometry
    stage: LightStage  # stage frame, every light of the job
    fit_focal: bool
    focal_sigma: float  # standard deviation of log focal before the fit
    window: Window
    fineness: Fineness = USUAL
    exposure: float = 1.0  # what the radiance of the lights that are held is times
    added: int = 0  # lights at the end of the stage that are the fit's own, not the job's
    # (3,) linear, what something grey in the photo shows; None: nobody said
    grey: np.ndarray | None = None
    pins: Pins | None = None  # the job's

    def lit_from_behind(self, lights: LightStage) -> Problem:
        """With more ``lights`` (stage frame), to be fitted like those of the job."""
        return replace(self, stage=joined(self.stage, lights), added=self.added + len(lights))

    def lit_as(self, other: Problem) -> Problem:
        """With what was found of the lights for the same photo at another size."""
        return replace(self, stage=other.stage, added=other.added, exposure=other.exposure)

    @property
    def lit(self) -> np.ndarray:
        """(N,) bool, the lights that may be traced: those that are not off, or all where nothing is
        left out.
        """
        return (self.stage.state != OFF) | (self.job.plan == FULL)

    @cached_property
    def lit_stage(self) -> LightStage:
        """The lights that are not off: the only ones that are traced."""
        return select_lights(self.stage, self.lit)

    @cached_property
    def lights(self) -> LightParameters:
        """How the lit lights are parametrised."""
        fitted = (self.lit_stage.state == ON) & ("lights" not in self.job.freeze)
        held = np.where(fitted[:, None], 0.0, self.exposure * self.lit_stage.radiance)
        uniform = self.job.light_color == "uniform"
        return LightParameters(fitted, held, uniform, np.flatnonzero(self.lit))

    @cached_property
    def skin(self) -> np.ndarray:
        """(h, w) 0..1, which pixels have the color of the face's own skin and show no glasses."""
        return np.where(self.frame, 0.0, self._skin_colored)

    @cached_property
    def frame(self) -> np.ndarray:
        """(h, w) bool, what a frame of glasses, or dark glass, hides."""
        return self._thin_frame | self.dark_glass

    @cached_property
    def _thin_frame(self) -> np.ndarray:
        frame = spectacle_frame(self.photograph.color, self._skin_colored, self.landmarks)
        return frame & ~self.dark_glass

    @cached_property
    def dark_glass(self) -> np.ndarray:
        """(h, w) bool, what sunglasses hide."""
        return sunglasses(self._skin_colored, self.landmarks)

    @cached_property
    def _skin_colored(self) -> np.ndarray:
        # A mesh of skin alone has neither lids nor lips that could part.
        parts = bool((self.geometry.triangle_part != SKIN).any())
        return skin_weight(self.photograph.color, self.landmarks, openings=parts)

    @cached_property
    def closed_teeth(self) -> float:
        """0 to 1, how surely closed teeth are seen between the lips."""
        return closed_teeth(self.photograph.color, self.skin, self.landmarks)

    @cached_property
    def teeth(self) -> np.ndarray | None:
        """(3,) radiance of the teeth where they are lit best; None where few are seen, or nothing
        has a hue.
        """
        photo = self.photograph
        if photo.tinted:
            return None
        return teeth_color(photo.color, self.skin, self.landmarks, photo.mask)

    @cached_property
    def lash_depth(self) -> float:
        """By how much the line of the lashes is darker than the lids, of the logarithm."""
        return lash_depth(self.photograph.color, self.landmarks)

    @cached_property
    def beard(self) -> Beard:
        """What the photo shows of one."""
        return beard_of(self.photograph.color, self.landmarks)

    @cached_property
    def paintable(self) -> np.ndarray:
        """(h, w) 0..1, which pixels may color the texture: the face inside its landmarks, brows
        and beard too, and skin.
        """
        paint = paint_weight(self._skin_colored, self.landmarks)
        return np.where(self.frame, 0.0, np.where(self.beard.covers, 1.0, paint))

    def clear(self, head: np.ndarray) -> np.ndarray:
        """(h, w) 0..1, how clear pixels are of what hides the fitted ``head`` (h, w) bool."""
        thin = self._thin_frame
        others = np.where(thin, 1.0, self.paintable)
        beside = clear_of_frame(thin, self.landmarks)
        return beside * clear_of_others(others, head, self.face_size_px)

    @property
    def start_camera(self) -> Camera:
        """The camera that a fit starts with: the job's starting focal length in it, if it has
        one.
        """
        focal = self.job.initial.get(FOCAL)
        if focal is None:
            return self.camera
        given = replace(self.window.full_camera(self.camera), focal_px=float(focal))
        return self.window.camera(given)

    def read_from_photo(self) -> dict[str, str]:
        """What was taken from the photo's file besides its pixels, in words; see Result.photo."""
        own, start = self.photograph.focal, self.window.full_camera(self.camera).focal_px
        if not self.fit_focal:
            focal = f"as given, {start:.5g} px; not fitted"
        elif own is not None:
            focal = f"fitted, from {own.focal_px:.5g} px +- {own.log_sigma:.0%} ({own.source})"
        else:
            focal = (
                f"fitted, from a guess of {start:.5g} px +- {self.focal_sigma:.0%} (the "
                "photo does not say)"
            )
        return {"size": self.window.words, "color": self.photograph.color_space, "focal": focal}

    @cached_property
    def white(self) -> float:
        """The radiance that PSNR takes for white."""
        mask = self.photograph.mask
        face = mask & face_pixels((mask.shape[0], mask.shape[1]), self.landmarks)
        return white_level(self.photograph.color, face if face.any() else mask)

    @cached_property
    def face_size_px(self) -> float:
        """Longer side of the bounding box of the face from chin to brows, in pixels of the
        photo.
        """
        return face_size_px(self.landmarks)

    def scale(self, face_px: float) -> float:
        """The factor, at most 1, that brings the face to ``face_px`` pixels."""
        return min(1.0, face_px / self.face_size_px)

    def photo_at(self, factor: float) -> Photo:
        """The photo resized by ``factor``."""
        camera = self.camera.scaled(factor)
        return self.photo_of(camera.width, camera.height)

    def photo_of(self, width: int, height: int) -> Photo:
        """The photo in this size."""
        source, size = self.photograph, (width, height)
        if size == source.size:
            return Photo(source.color.astype(np.float64), source.mask, self.skin, source.clipped)
        return Photo(
            resize(source.color, *size).astype(np.float64),
            resize(source.mask.astype(np.float32), *size) > 0.99,
            resize(self.skin, *size),
            resize(source.clipped.astype(np.float32), *size) > 0.25,
        )

    def reduced(self, face_px: float) -> Problem:
        """The problem of a smaller photo, whose face has ``face_px`` pixels; of one that is no
        larger, itself.
        """
        factor = self.scale(face_px)
        if factor == 1.0:
            return self
        photo = self.photo_at(factor)
        small = replace(
            self.photograph,
            color=photo.color.astype(np.float32),
            mask=photo.usable,
            clipped=photo.clipped,
        )
        return replace(
            self,
            photograph=small,
            camera=self.camera.scaled(factor),
            landmarks=self.landmarks_at(factor),
            pins=self.pins_at(factor),
        )

    def landmarks_at(self, factor: float) -> Landmarks:
        """The landmarks of the photo resized by ``factor``."""
        return replace(self.landmarks, points=self.landmarks.points * factor)

    def pins_at(self, factor: float) -> Pins | None:
        """The pins of the photo resized by ``factor``."""
        pins = self.pins
        if pins is None:
            return None
        return replace(pins, points=pins.points * factor, deviation=pins.deviation * factor)

    @cached_property
    def fingerprint(self) -> str:
        """Changes when anything that the answer depends on changes (not the budget)."""
        digest = hashlib.sha256()
        digest.update(self.photograph.color.tobytes())
        digest.update(self.geometry.mean.tobytes())
        digest.update(self.geometry.model_basis.sum(axis=0, dtype=np.float64).tobytes())
        own = len(self.stage) - self.added
        for name in LIGHT_ARRAYS:
            digest.update(np.ascontiguousarray(getattr(self.stage, name)[:own]).tobytes())
        if self.job.camera_to_stage is not None:
            digest.update(np.ascontiguousarray(self.job.camera_to_stage).tobytes())
        for name, value in sorted(self.job.initial.items()):
            digest.update(name.encode() + np.ascontiguousarray(value).tobytes())
        settings = {
            "camera": self.camera.to_json(),
            "landmarks": self.landmarks.to_json(),
            "freeze": list(self.job.freeze),
            "weights": vars(self.job.weights),
            "seed": self.job.seed,
            "light_color": self.job.light_color,
            "model": self.job.model,
            "fit_focal": self.fit_focal,
            "focal_sigma": self.focal_sigma,
            "plan": self.job.plan,
            "quality": self.job.quality,
            "fineness": self.fineness.of_steps,
        }
        if self.job.surround != AUTO:  # checkpoints of before it could be said still count
            settings["surround"] = self.job.surround
        if self.job.exposure != KNOWN:
            settings["exposure"] = self.job.exposure
        if self.job.white_balance is not None:
            settings["white_balance"] = self.job.white_balance
        if self.job.skin_tone is not None:
            settings["skin_tone"] = self.job.skin_tone
        if self.job.pins is not None:
            settings["pins"] = self.job.pins.to_json()
        digest.update(json.dumps(finite(settings), sort_keys=True).encode())
        return digest.hexdigest()


def _check_initial(initial: dict[str, np.ndarray], model: FaceModel, fineness: Fineness) -> None:
    """Raise InputError for a starting value of a wrong name, shape or kind."""
    specular = initial.get("specular")
    side = fineness.specular_size if specular is None or specular.ndim != 2 else len(specular)
    shapes = kept_shapes(model, side) | {"model_to_camera": (4, 4), FOCAL: ()}
    for name, value in initial.items():
        if name not in shapes:
            raise InputError(
                f"The job has a starting value '{name}'; expected one of {', '.join(shapes)}."
            )
        if value.shape != shapes[name] or not np.isfinite(value).all():
            raise InputError(
                f"The starting {name} has shape {value.shape}; '{model.name}' takes "
                f"{shapes[name]} finite numbers."
            )
    if not FOCAL_MIN <= float(initial.get(FOCAL, FOCAL_MIN)) <= FOCAL_MAX:
        raise InputError(
            f"The starting {FOCAL} is {float(initial[FOCAL]):g}; expected a positive number of "
            "the photo's pixels."
        )
    rotation = initial.get("model_to_camera", np.eye(4))[:3, :3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        raise InputError(
            "The starting model_to_camera is not a rigid transform (rotation and translation, "
            "no scale)."
        )


def _check_size(model: FaceModel) -> None:
    """Raise InputError for a model that cannot be in metres: lights, shadows and lenses depend on
    them.
    """
    size = float(np.ptp(model.vertices, axis=0).max()) if len(model.vertices) else 0.0
    if not MODEL_SIZE_MIN <= size <= MODEL_SIZE_MAX:
        raise InputError(
            f"The face model '{model.name}' is {size:.3g} metres large, expected about 0.3 (at "
            f"least {MODEL_SIZE_MIN:g}, at most {MODEL_SIZE_MAX:g}); scale it to metres."
        )


def _check_rendered(geometry: FaceGeometry, scheme: str) -> None:
    """Raise InputError for a model with nothing to compare or to paint on, or landmarks on what is
    not rendered.
    """
    name = geometry.model.name
    if not geometry.fitted.any():
        raise InputError(
            f"The face model '{name}' has no skin polygon in its region 'face'; nothing could "
            "be fitted."
        )
    vertices, weights = geometry.model.landmark_vertices(scheme)
    lost = ((geometry.new_index[vertices] < 0) & (weights != 0)).any(axis=1)
    if lost.any():
        raise InputError(
            f"The face model '{name}' has landmark {int(lost.argmax())} of '{scheme}' on a vertex "
            "that is not rendered; put it on the skin."
        )
    if geometry.face_normals(geometry.mean)[geometry.fitted, 2].sum() <= 0:
        raise InputError(
            f"The face model '{name}' has polygons that face inward, or does not look along +Z; "
            "recalculate its normals to point outward."
        )
    a, b, c = np.moveaxis(
        geometry.model.uvs[geometry.triangle_uvs[geometry.fitted]].astype(float), 1, 0
    )
    if np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))).sum() < UV_AREA_MIN:
        raise InputError(
            f"The face model '{name}' has no usable texture coordinates: its skin covers no area "
            "of the UV square; unwrap it."
        )


def _check_pins(pins: Pins, geometry: FaceGeometry) -> None:
    """Raise InputError for a pin that is not on what is rendered of the model."""
    name, count = geometry.model.name, len(geometry.new_index)
    outside = (pins.corners >= count).any(axis=1)
    if outside.any():
        raise InputError(
            f"Pin {int(outside.argmax())} is on vertex {pins.corners.max()}, the face model "
            f"'{name}' has {count}; pins are of one face model, make them again on this one."
        )
    lost = ((geometry.new_index[pins.corners] < 0) & (pins.weights != 0)).any(axis=1)
    if lost.any():
        raise InputError(
            f"Pin {int(lost.argmax())} is on a part of '{name}' that the fit does not look at; "
            "put it on the skin, the eyes or the mouth."
        )


def select_lights(stage: LightStage, keep: np.ndarray) -> LightStage:
    """The lights of ``stage`` where ``keep`` (N,) is true."""
    return LightStage(**{name: getattr(stage, name)[keep] for name in LIGHT_ARRAYS})


def read_problem(
    job: Job,
    emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None,
    geometry: FaceGeometry | None = None,
    fineness: Fineness = USUAL,
) -> Problem:
    """Read and check everything a job names. Raises InputError with what is wrong.

    The landmarks of a job that has none are detected, and part of the problem's job; ``emit`` is
    told of it. ``geometry`` is that of the job's model, when another photo of the same person has
    read it already.
    """
    fineness = fineness.of(job)
    photograph = read_photograph(job.image)
    width, height = photograph.size
    own = photograph.focal
    camera = job.camera or Camera.default(width, height, None if own is None else own.focal_px)
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"The camera is for {camera.width} x {camera.height} pixels but the photo "
            f"'{job.image}' has {width} x {height}; give the camera of this photo."
        )
    job = with_landmarks(job, photograph, landmark_model, emit)
    assert job.landmarks is not None
    job.landmarks.check_inside(width, height)
    stage = job.stage or fibonacci_stage()
    if (stage.state == OFF).all():
        raise InputError(
            "All lights of the stage are off; nothing could light the face. Turn at least one on."
        )
    if (stage.state != ON).all() and not (stage.radiance[stage.state == FROZEN] > 0).any():
        raise InputError(
            "All lights of the stage are frozen at radiance 0; free one or give it a radiance."
        )
    if job.white_balance is not None and ("lights" in job.freeze or (stage.state != ON).all()):
        raise InputError(
            "The job gives a white balance, but holds all lights, whose color is known; free the "
            "lights, or leave out the white balance."
        )
    if job.skin_tone is not None and "albedo" in job.freeze:
        raise InputError(
            "The job gives a skin tone, but holds the albedo, which is one; free the albedo, or "
            "leave out the skin tone."
        )
    model = load_model(job.model) if geometry is None else geometry.model
    landmarks = known_to(model, job.landmarks)
    model.landmark_vertices(landmarks.scheme)
    _check_size(model)
    _check_initial(job.initial, model, fineness)
    if FOCAL in job.initial and (job.camera is not None or "focal" in job.freeze):
        raise InputError(
            f"The job holds the focal length, and has a starting value for it ({FOCAL}); leave "
            "one of them out."
        )
    geometry = geometry or FaceGeometry(model)
    _check_rendered(geometry, landmarks.scheme)
    if job.pins is not None:
        _check_pins(job.pins, geometry)
    fit_focal = job.camera is None and "focal" not in job.freeze
    focal_sigma = FOCAL_SIGMA if own is None or job.camera is not None else own.log_sigma
    window = Window.of(width, height, landmarks, fineness)
    shown = window.photograph(photograph)
    if job.white_balance is None:
        shown = as_seen_in_color(shown, window.landmarks(landmarks))
    return Problem(
        job,
        shown,
        window.camera(camera),
        window.landmarks(landmarks),
        geometry,
        stage,
        fit_focal,
        focal_sigma,
        window,
        fineness,
        grey=_grey(job, photograph),
        pins=None if job.pins is None else window.pins(job.pins),
    )


def _grey(job: Job, photograph: Photograph) -> np.ndarray | None:
    """(3,) what the job's grey shows; a pixel is looked up in the whole ``photograph``."""
    if job.white_balance is None or len(job.white_balance) == CHANNELS:
        return None if job.white_balance is None else np.array(job.white_balance)
    return color_of_grey(photograph.color, photograph.mask, photograph.clipped, *job.white_balance)
