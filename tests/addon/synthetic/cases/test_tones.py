"""The 36 people of known skin tone are of the types that their names say."""

from __future__ import annotations

import numpy as np

from addon.synthetic.people import person_of
from facestage.contract.face_model import EYES, FaceModel
from facestage.contract.skin_tone import SKIN_TYPES, skin_type, typology_angle


def test_six_types_two_colors_three_lights() -> None:
    from facestage_blender.synthetic.cases.tones import LIGHTS, tones

    cases = tones()
    assert len(cases) == 36 and len(LIGHTS) == 3
    assert len({seed for _, seed in cases.values()}) == 36
    kinds = [name.rsplit("_", 2)[0].replace("_", " ") for name in cases]
    assert list(dict.fromkeys(kinds)) == [name for name, _ in SKIN_TYPES]


def median_color(model: FaceModel, texture: np.ndarray) -> np.ndarray:
    """Of the narrow face."""
    inside = np.zeros(len(model.vertices), bool)
    inside[model.regions["narrow_face"]] = True
    rows = inside[model.triangles].all(axis=1)
    u, v = model.uvs[np.unique(model.triangle_uvs[rows])].T
    size = len(texture)
    at = ((1 - v) * size).astype(int), (u * size).astype(int)
    return np.median(texture[at], axis=0)


def test_people_have_the_tone_of_their_type_and_eyes_of_their_own(model: FaceModel) -> None:
    from facestage_blender.synthetic.cases.tones import tones

    u, v = model.uvs[np.unique(model.triangle_uvs[model.triangle_part == EYES])].T
    at = ((1 - v) * 191).astype(int), (u * 191).astype(int)
    whites = []
    for name, (recipe, seed) in tones().items():
        if name.endswith("a_studio"):
            person = person_of(model, recipe, 3, seed)
            angle = float(typology_angle(median_color(model, person.albedo)))
            assert skin_type(angle).replace(" ", "_") == name.removesuffix("_a_studio")
            whites.append(np.log(np.median(person.albedo[at], axis=0)))
    assert np.std(whites, axis=0).min() > 0.03


def test_under_each_light_it_is_somebody_else_of_the_same_tone(model: FaceModel) -> None:
    from facestage_blender.synthetic.cases.tones import tones

    cases = tones()
    first, second = (
        person_of(model, cases[name][0], 3, cases[name][1])
        for name in ("dark_a_studio", "dark_a_lamp")
    )
    assert not np.allclose(first.identity, second.identity)
    angle, other = (typology_angle(median_color(model, each.albedo)) for each in (first, second))
    np.testing.assert_allclose(angle, other, atol=2.0)
