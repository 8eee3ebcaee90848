"""Extreme skin, shapes and face models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job, Weights
from facestage.contract.parameters import PARAMETERS
from facestage.contract.skin_tone import ANGLES
from facestage.models.registry import load_model
from facestage.stress.case import REFUSAL, Suite
from facestage.stress.scene import SPECULAR_SIZE, exposed, plain_scene, render, write_job

suite = Suite()


def _fit_of(folder: Path, model: FaceModel) -> Job:
    """The plain scene made, and fitted, with ``model``."""
    scene = plain_scene(model)
    return write_job(folder, scene, render(scene))


@suite.add("mirror-skin", "roughness 0.05: highlights of a few pixels", worst_mm=1.0, worst_psnr=20)
def mirror_skin(folder: Path) -> Job:
    """The smallest roughness that the model knows."""
    scene = replace(plain_scene(), roughness=0.05)
    return write_job(folder, scene, render(scene))


@suite.add("chalk-skin", "roughness 1 and no specular at all", worst_mm=0.8, worst_psnr=34)
def chalk_skin(folder: Path) -> Job:
    """Specular parameters that nothing observes."""
    scene = replace(plain_scene(), roughness=1.0, c_spec=0.0)
    return write_job(folder, scene, render(scene))


@suite.add(
    "waxen-skin",
    "light wanders below the skin farther than the nose is long, the fit's bound is a fifth",
    worst_mm=2.0,
)
def waxen_skin(folder: Path) -> Job:
    """Shading as of a candle: red light has hardly any."""
    scene = replace(plain_scene(), scattering=15.0)
    return write_job(folder, scene, render(scene))


@suite.add(
    "albedo-near-zero",
    "a model whose skin reflects a thousandth: only highlights are seen",
    worst_mm=1.2,
)
def albedo_near_zero(folder: Path) -> Job:
    """The diffuse part vanishes; so do the derivatives of the albedo."""
    model = load_model("default")
    return _fit_of(folder, replace(model, albedo_mean=np.full_like(model.albedo_mean, 1e-3)))


@suite.add(
    "albedo-near-one",
    "a model whose skin reflects all: the albedo's upper end",
    worst_mm=1.0,
    worst_psnr=30,
)
def albedo_near_one(folder: Path) -> Job:
    """The albedo is cut off below 1, where its derivative ends."""
    model = load_model("default")
    return _fit_of(folder, replace(model, albedo_mean=np.full_like(model.albedo_mean, 0.995)))


@suite.add(
    "pale-skin-told-dark", "usual skin that somebody says is the darkest there is", worst_mm=2.0
)
def pale_skin_told_dark(folder: Path) -> Job:
    """Skin of a fifteenth of its albedo, light of fifteen times its radiance, and far too much
    gloss.
    """
    scene = plain_scene()
    return replace(write_job(folder, scene, render(scene)), skin_tone=ANGLES[0])


@suite.add(
    "ten-sigma-face",
    "a true face ten standard deviations out in one mode",
    worst_mm=4.0,
    worst_psnr=26,
)
def ten_sigma_face(folder: Path) -> Job:
    """The prior's energy is 50 at the truth."""
    scene = plain_scene()
    identity = scene.identity.copy()
    identity[1] = 10.0
    scene = replace(scene, identity=identity)
    return write_job(folder, scene, render(scene))


@suite.add(
    "ten-sigma-start",
    "starting values of ten standard deviations in every mode",
    worst_mm=1.5,
    worst_psnr=30,
)
def ten_sigma_start(folder: Path) -> Job:
    """The first mesh is a crumpled ball."""
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    sign = np.where(np.arange(len(scene.identity)) % 2, 10.0, -10.0)
    albedo = np.where(np.arange(len(scene.albedo)) % 2, 10.0, -10.0)
    return replace(job, initial=job.initial | {"identity": sign, "albedo": albedo})


@suite.add(
    "degenerate-triangles",
    "triangles of no area, and 400 polygons twice",
    worst_mm=0.8,
    worst_psnr=34,
)
def degenerate_triangles(folder: Path) -> Job:
    """What careless modelling leaves in a mesh."""
    model = load_model("default")
    flat, flat_uvs = model.polygons[:200].copy(), model.polygon_uvs[:200].copy()
    flat[:, 1], flat_uvs[:, 1] = flat[:, 0], flat_uvs[:, 0]
    flat[100:, 2], flat_uvs[100:, 2] = flat[100:, 0], flat_uvs[100:, 0]
    again = slice(0, 400)
    return _fit_of(
        folder,
        replace(
            model,
            polygons=np.concatenate([model.polygons, flat, model.polygons[again]]),
            polygon_uvs=np.concatenate([model.polygon_uvs, flat_uvs, model.polygon_uvs[again]]),
            polygon_part=np.concatenate(
                [model.polygon_part, model.polygon_part[:200], model.polygon_part[again]]
            ),
        ),
    )


@suite.add("no-identity-modes", "a model without identity modes", worst_mm=0.8, worst_psnr=34)
def no_identity_modes(folder: Path) -> Job:
    """A scan of one person: only expressions move."""
    model = load_model("default")
    return _fit_of(
        folder, replace(model, identity_names=(), identity_basis=model.identity_basis[:0])
    )


@suite.add(
    "no-shape-modes",
    "a model with neither identity nor expression modes",
    worst_mm=0.1,
    worst_psnr=34,
)
def no_shape_modes(folder: Path) -> Job:
    """Only the pose moves."""
    model = load_model("default")
    return _fit_of(
        folder,
        replace(
            model,
            identity_names=(),
            identity_basis=model.identity_basis[:0],
            expression_names=(),
            expression_basis=model.expression_basis[:0],
        ),
    )


@suite.add("no-albedo-basis", "a model with a single albedo", worst_mm=0.8, worst_psnr=34)
def no_albedo_basis(folder: Path) -> Job:
    """The texture alone explains the skin."""
    model = load_model("default")
    return _fit_of(folder, replace(model, albedo_basis=model.albedo_basis[:0]))


@suite.add(
    "duplicate-modes",
    "every identity mode twice: a null direction for each",
    worst_mm=0.8,
    worst_psnr=34,
)
def duplicate_modes(folder: Path) -> Job:
    """Only the prior tells the twins apart."""
    model = load_model("default")
    names = tuple(f"{name}_again" for name in model.identity_names)
    basis = np.concatenate([model.identity_basis, model.identity_basis])
    return _fit_of(
        folder, replace(model, identity_names=model.identity_names + names, identity_basis=basis)
    )


@suite.add(
    "empty-modes", "identity modes that move nothing, and one that moves everything", 0.8, 34
)
def empty_modes(folder: Path) -> Job:
    """Zero columns, and a column that is the translation once more."""
    model = load_model("default")
    basis = model.identity_basis.copy()
    basis[40:60] = 0.0
    basis[60] = [0.02, 0.0, 0.0]
    return _fit_of(folder, replace(model, identity_basis=basis))


@suite.add(
    "model-in-millimetres", "a face model in millimetres, where metres are expected", right=REFUSAL
)
def model_in_millimetres(folder: Path) -> Job:
    """A head of 300 metres amid lights one metre away."""
    model = load_model("default")
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    large = replace(
        model,
        vertices=1e3 * model.vertices,
        identity_basis=1e3 * model.identity_basis,
        expression_basis=1e3 * model.expression_basis,
    )
    large.save(folder / "model.npz")
    return replace(job, model=f"npz:{folder / 'model.npz'}", truth=None)


@suite.add("inside-out-model", "a model whose polygons all face inward", right=REFUSAL)
def inside_out_model(folder: Path) -> Job:
    """Normals that point into the head; the photo is of the same model, made properly."""
    model = load_model("default")
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    quads = model.polygons[:, 3] >= 0
    polygons, uvs = model.polygons.copy(), model.polygon_uvs.copy()
    for array in (polygons, uvs):
        array[quads] = array[quads][:, ::-1]
        array[~quads, :3] = array[~quads, 2::-1]
    replace(model, polygons=polygons, polygon_uvs=uvs).save(folder / "model.npz")
    return replace(job, model=f"npz:{folder / 'model.npz'}")


@suite.add("no-uvs", "a model without texture coordinates: all of them are 0", right=REFUSAL)
def no_uvs(folder: Path) -> Job:
    """There is no texel to paint."""
    model = load_model("default")
    return _fit_of(folder, replace(model, uvs=np.zeros_like(model.uvs)))


@suite.add(
    "landmark-in-the-void",
    "a model with a landmark on a vertex that no rendered polygon has",
    right=REFUSAL,
)
def landmark_in_the_void(folder: Path) -> Job:
    """The landmark's vertex does not exist for the fit."""
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    model = _with_lonely_vertex(scene.model)
    table = model.landmarks["ibug68"].copy()
    table[30, :3] = len(model.vertices) - 1
    replace(model, landmarks={"ibug68": table}).save(folder / "model.npz")
    return replace(job, model=f"npz:{folder / 'model.npz'}", truth=None)


def _with_lonely_vertex(model: FaceModel) -> FaceModel:
    """The model with one more vertex, of no polygon."""

    def more(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, array[..., -1:, :]], axis=-2)

    return replace(
        model,
        vertices=more(model.vertices),
        identity_basis=more(model.identity_basis),
        expression_basis=more(model.expression_basis),
        albedo_mean=more(model.albedo_mean),
        albedo_basis=more(model.albedo_basis),
    )


@suite.add(
    "landmarks-do-not-count",
    "a weight of 0 on the landmarks after they gave the first pose",
    1.6,
    30,
)
def landmarks_do_not_count(folder: Path) -> Job:
    """The photo alone, from the mean face."""
    scene = plain_scene()
    return replace(write_job(folder, scene, render(scene)), weights=Weights(landmarks=0.0))


@suite.add("photo-does-not-count", "a weight of 0 on the photo", worst_mm=1.2)
def photo_does_not_count(folder: Path) -> Job:
    """The landmarks alone: light and skin rest on the priors."""
    scene = plain_scene()
    return replace(write_job(folder, scene, render(scene)), weights=Weights(photo=0.0))


@suite.add("everything-frozen", "no parameter may move; all start at the truth", 0.01, 30)
def everything_frozen(folder: Path) -> Job:
    """The stage's own radiance and the starting values are the answer: here, the truth."""
    scene = exposed(plain_scene())
    initial = {
        "identity": scene.identity,
        "expression": scene.expression,
        "albedo": scene.albedo,
        "specular": scene.state.specular,
        "roughness": np.array(scene.roughness),
        "model_to_camera": scene.state.model_to_camera,
    }
    return replace(write_job(folder, scene, render(scene)), freeze=PARAMETERS, initial=initial)


@suite.add(
    "no-priors",
    "no statistical prior and no light term: every weak direction is open",
    worst_mm=2.5,
)
def no_priors(folder: Path) -> Job:
    """Damping and bounds alone hold what the photo does not say."""
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    return replace(job, weights=Weights(prior=0.0, light=0.0))


@suite.add(
    "fine-specular-map", "a specular map of 1024 texels, most of them unseen", 0.6, 36, seconds=600
)
def fine_specular_map(folder: Path) -> Job:
    """The usual size of the map on a face of 80 pixels."""
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    return replace(
        job,
        initial={name: value for name, value in job.initial.items() if len(value) != SPECULAR_SIZE},
    )
