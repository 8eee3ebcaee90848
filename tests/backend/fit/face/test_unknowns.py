"""The table of the unknowns: it agrees with the contract's, covers the state, and does what its
rows say.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from facestage.contract.parameters import KEPT, PARAMETERS
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import (
    BELOW,
    BLOCKS,
    GLOSS,
    LAMPS,
    RELIEF,
    SHAPE,
    SHARED,
    SKIN,
    STATE_FIELDS,
    UNKNOWNS,
    Unknown,
    from_kept,
    kept,
    kept_shapes,
    start_values,
    with_unknowns,
)
from reference.synthetic_scene import Scene, moved


def each_unknown() -> pytest.MarkDecorator:
    return pytest.mark.parametrize("unknown", UNKNOWNS, ids=BLOCKS)


def changed_fields(state: State, other: State) -> set[str]:
    return {
        field.name
        for field in fields(State)
        if not np.array_equal(getattr(state, field.name), getattr(other, field.name))
    }


@pytest.fixture
def elsewhere(scene: Scene) -> State:
    """Another state in every field."""
    layout = Layout(scene.state)
    return layout.apply(scene.state, np.full(layout.size, 0.01))


def test_both_tables_have_the_same_rows():
    assert len(set(BLOCKS)) == len(BLOCKS)
    assert set(BLOCKS) == set(PARAMETERS)


def test_the_rows_own_the_state_s_fields_once_each():
    owned = [name for unknown in UNKNOWNS for name in unknown.fields]
    assert sorted(owned) == sorted(field.name for field in fields(State)) == sorted(STATE_FIELDS)
    assert set(KEPT) <= set(owned), "what a result keeps is a field of that name"


def test_every_unknown_moves_in_some_phase():
    assert sorted(SHAPE + RELIEF + SKIN + LAMPS + GLOSS + BELOW) == sorted(BLOCKS)
    assert SHAPE == ("pose", "focal", "identity", "expression")
    assert SHARED == ("identity", "relief", "albedo", "roughness", "specular")


@each_unknown()
def test_a_step_of_one_unknown_changes_its_fields_alone(scene: Scene, unknown: Unknown):
    after = moved(scene.state, **{unknown.name: 0.01})
    assert changed_fields(scene.state, after) == set(unknown.fields)
    for name in set(STATE_FIELDS) - set(unknown.fields):
        assert getattr(after, name) is getattr(scene.state, name)


@each_unknown()
def test_an_unknown_is_taken_from_another_state_by_its_name(
    scene: Scene, elsewhere: State, unknown: Unknown
):
    taken = with_unknowns(scene.state, elsewhere, {unknown.name})
    assert changed_fields(scene.state, taken) == set(unknown.fields)
    assert not changed_fields(replace(taken), with_unknowns(taken, elsewhere, {unknown.name}))
    assert not changed_fields(with_unknowns(scene.state, elsewhere, BLOCKS), elsewhere)


def test_numbers_stay_numbers_and_maps_keep_their_shape(scene: Scene, elsewhere: State):
    assert type(elsewhere.roughness) is float
    assert elsewhere.specular.shape == scene.state.specular.shape
    assert elsewhere.light_position.shape == scene.state.light_position.shape


@pytest.mark.parametrize("box", [True, False])
def test_a_fit_starts_within_the_bounds_at_no_cost(scene: Scene, box: bool):
    """The mean of each prior is where a fit starts, so a row cannot say two things."""
    start = start_values({}, kept_shapes(scene.model, 6))
    state = replace(scene.state, **start)
    known = scene.known(expression_box=box)
    layout = Layout(state)
    low, high = layout.bounds(known)
    for unknown in UNKNOWNS:
        where = layout.slices[unknown.name]
        values = layout.values(state)[where]
        assert (values >= low[where]).all() and (values <= high[where]).all(), unknown.name
        if unknown.name in KEPT:
            for name, prior in unknown.priors.items():
                residual = prior(known, len(values)).residuals(values)
                np.testing.assert_allclose(residual, 0, atol=1e-12, err_msg=name)


def test_a_job_may_start_what_a_result_keeps(scene: Scene):
    shapes = kept_shapes(scene.model, 6)
    initial = {"roughness": np.array(0.3), "specular": np.full((4, 4), 0.5, np.float32)}
    start = start_values(initial, shapes)
    assert set(start) == set(KEPT) and start["roughness"] == 0.3
    assert type(start["roughness"]) is float
    np.testing.assert_array_equal(start["specular"], 0.5)
    assert start["specular"].shape == (4, 4) and start["specular"].dtype == np.float64
    assert start["identity"].shape == scene.state.identity.shape and not start["identity"].any()


def test_what_a_result_keeps_comes_back(scene: Scene, elsewhere: State):
    arrays = {name: np.asarray(value) for name, value in kept(elsewhere).items()}
    back = replace(scene.state, **from_kept(arrays))
    assert changed_fields(back, elsewhere) == set(STATE_FIELDS) - set(KEPT)
    assert type(back.roughness) is float
