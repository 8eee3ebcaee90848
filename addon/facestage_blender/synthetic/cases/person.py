"""People drawn from a seed: shape, expression, skin, pose, light and what they wear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from facestage.contract.arkit import slider_weights
from facestage.contract.face_model import EYES, SKIN, TEETH, FaceModel
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.skin_tone import from_cielab

from ...pictures.texture import paint_vertices
from ..truth import DISTANCE, FOCAL_PX, Person
from . import relief, skin, worn
from .lamps import light_stage
from .recipe import Recipe
from .surroundings import walls

ALBEDO_SIZE, SPECULAR_SIZE, HEIGHT_SIZE = 1024, 32, 2048
TEXTURE_MISMATCH = 0.05  # relative standard deviation of the albedo that the model cannot explain
SMILE = {"mouthSmileLeft": 0.55, "mouthSmileRight": 0.5, "jawOpen": 0.12, "browInnerUp": 0.35}
POSE_SPREAD = (4.0, 3.0, 3.0)  # degrees, one standard deviation of yaw, pitch and roll
PLACE_SPREAD = 0.008  # metres
# Of the first skin mode: how far from what a recipe says, and from where to where people are drawn.
TONE_SPREAD, LIGHTEST, DARKEST = 0.05, -0.35, 1.2
# Of the logarithm: how white eyes and teeth are, and how yellow (red less blue).
WHITE_SPREAD, YELLOW_SPREAD = 0.12, 0.08


def random_person(model: FaceModel, seed: int, albedo_size: int = ALBEDO_SIZE) -> Person:
    """A smiling person under five lights of the default stage: shape, skin and tints drawn from
    ``seed``.
    """
    rng = np.random.default_rng(seed)
    identity, delta = _identity(model, rng), _skin_tone(model, rng)
    albedo = skin.mottled(_painted(model, delta, albedo_size), TEXTURE_MISMATCH, rng)
    specular = _specular(rng)
    pose = _pose((14.0, 4.0, -3.0), (0.012, -0.006, -DISTANCE))
    stage = fibonacci_stage()
    radiance = np.zeros((len(stage), 3))
    for light, power in zip((3, 6, 11, 14, 1), (10.0, 5.0, 3.0, 2.0, 1.5), strict=True):
        radiance[light] = power * (1 + 0.15 * rng.uniform(-1, 1, 3))
    return Person(
        identity,
        expression_weights(model, SMILE),
        np.clip(albedo, 0.005, 0.95),
        specular,
        0.42,
        pose,
        stage.with_radiance(radiance),
    )


def person_of(
    model: FaceModel,
    recipe: Recipe,
    seed: int,
    same: int | None = None,
    albedo_size: int = ALBEDO_SIZE,
) -> Person:
    """The person and the light of a recipe; whatever the recipe leaves open is drawn from ``seed``.

    ``same``: the seed of who it is, so that photos of other seeds show one person: shape and skin
    are drawn from it.
    """
    rng = np.random.default_rng(seed)
    own = rng if same is None else np.random.default_rng(same)
    identity, delta = _identity(model, own), _skin_tone(model, own)
    if recipe.melanin is not None and len(delta):
        delta[0] = recipe.melanin + TONE_SPREAD * own.uniform(-1, 1)
    expression = expression_weights(model, _everyday_expression(rng) | dict(recipe.expression))
    painted = model.albedo(delta)
    if recipe.tone is not None:
        painted = _toned(model, painted, recipe.tone, own)
    painted = recipe.shade * _textured(model, painted, albedo_size)
    albedo = skin.mottled(painted, recipe.mottle, own)
    if recipe.freckles:
        albedo = skin.freckled(albedo, model, own)
    if recipe.beard:
        albedo = skin.bearded(albedo, model, own)
    roughness = own.uniform(0.35, 0.5) if recipe.roughness is None else recipe.roughness
    angles = np.array(recipe.pose) + np.array(POSE_SPREAD) * np.clip(rng.normal(size=3), -1.5, 1.5)
    place = np.array(
        [0, 0, -recipe.distance]
    ) + PLACE_SPREAD * recipe.distance / DISTANCE * rng.uniform(-1, 1, 3)
    vertices = model.shape(identity, expression)
    things = [worn.KINDS[kind](model, vertices, rng) for kind in recipe.worn]
    tone = tuple(np.median(albedo.reshape(-1, 3), axis=0))
    specular = _specular(own)
    return Person(
        identity,
        expression,
        np.clip(albedo, 0.005, 0.95),
        specular,
        float(roughness),
        _pose(angles, place),
        light_stage(recipe.lamps, rng),
        tuple(replace(each, color=tone) if each.of_skin else each for each in things),
        recipe.interreflection,
        FOCAL_PX * recipe.distance / DISTANCE,
        () if recipe.walls is None else walls(recipe.walls, recipe.lamps),
        recipe.optics,
        recipe.sky,
        recipe.scattering,
        relief.height_map(model, HEIGHT_SIZE, own) if recipe.relief else None,
    )


def expression_weights(model: FaceModel, wanted: Mapping[str, float]) -> np.ndarray:
    """(e,) weights of the model's expressions for weights by ARKit's names, where the model has
    them, or by its own.
    """
    by_name = dict(wanted) | slider_weights(wanted, model.expression_names)
    return np.array([by_name.get(name, 0.0) for name in model.expression_names])


def _everyday_expression(rng: np.random.Generator) -> dict[str, float]:
    """Weights of a face that is being talked to."""
    smile, brow, squint = rng.uniform(0, 0.5), rng.uniform(-0.3, 0.4), rng.uniform(0, 0.3)
    uneven = 1 + 0.2 * rng.uniform(-1, 1, 3)
    return {
        "mouthSmileLeft": smile,
        "mouthSmileRight": smile * uneven[0],
        "browInnerUp": max(brow, 0.0),
        "browDownLeft": max(-brow, 0.0),
        "browDownRight": max(-brow, 0.0) * uneven[1],
        "eyeSquintLeft": squint,
        "eyeSquintRight": squint * uneven[2],
        "jawOpen": rng.uniform(0, 0.15),
    }


def _identity(model: FaceModel, rng: np.random.Generator) -> np.ndarray:
    return np.clip(0.8 * rng.normal(size=len(model.identity_names)), -2, 2)


def _skin_tone(model: FaceModel, rng: np.random.Generator) -> np.ndarray:
    result = np.clip(0.6 * rng.normal(size=len(model.albedo_basis)), -1.5, 1.5)
    # The first mode makes skin darker; hardly any is lighter than the mean.
    result[:1] = np.clip(result[:1], LIGHTEST, DARKEST)
    return result


def _toned(
    model: FaceModel, albedo: np.ndarray, tone: tuple[float, float, float], rng: np.random.Generator
) -> np.ndarray:
    """The vertices' albedo (n, 3) with skin whose median over the face is ``tone`` (CIELAB), and
    eyes and teeth somewhat brighter or darker, whiter or yellower.
    """
    result = albedo.copy()
    skin_vertices = np.unique(model.triangles[model.triangle_part == SKIN])
    face = np.intersect1d(skin_vertices, model.regions.get("narrow_face", skin_vertices))
    result[skin_vertices] *= from_cielab(np.array(tone)) / np.median(albedo[face], axis=0)
    for part in (EYES, TEETH):
        white, yellow = rng.normal(size=2) * (WHITE_SPREAD, YELLOW_SPREAD)
        vertices = np.unique(model.triangles[model.triangle_part == part])
        vertices = np.setdiff1d(vertices, skin_vertices)
        result[vertices] *= np.exp(white + yellow * np.array([0.5, 0.0, -0.5]))
    return result


def _painted(model: FaceModel, delta: np.ndarray, size: int) -> np.ndarray:
    return _textured(model, model.albedo(delta), size)


def _textured(model: FaceModel, colors: np.ndarray, size: int) -> np.ndarray:
    return paint_vertices(colors, model.triangles, model.uvs, model.triangle_uvs, size)


def _specular(rng: np.random.Generator) -> np.ndarray:
    return np.clip(0.75 + 0.25 * skin.noise(rng, SPECULAR_SIZE, 6), 0.2, 1.4)


def _pose(
    angles: np.ndarray | tuple[float, ...], place: np.ndarray | tuple[float, ...]
) -> np.ndarray:
    """(4, 4) model to camera: yaw, then pitch, then roll, in degrees, and the face's place in
    metres.
    """
    yaw, pitch, roll = np.radians(angles)
    pose = np.eye(4)
    pose[:3, :3] = _turn(2, roll) @ _turn(0, pitch) @ _turn(1, yaw)
    pose[:3, 3] = place
    return pose


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) right-handed rotation about a coordinate axis."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[a, a] = matrix[b, b] = np.cos(angle)
    matrix[a, b], matrix[b, a] = -np.sin(angle), np.sin(angle)
    return matrix
