"""The table of what a fit may change, and what it makes of the files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from facestage.contract.parameters import KEPT, PARAMETERS, TABLE, as_fields
from facestage.contract.result import Result


def test_the_rows_that_saved_scenes_know_by_their_number():
    """A .blend keeps what is frozen as bits."""
    assert PARAMETERS[:9] == (
        "identity",
        "expression",
        "pose",
        "albedo",
        "specular",
        "roughness",
        "lights",
        "light_position",
        "focal",
    )


def test_every_row_says_in_words_what_freezing_does():
    assert all(row.keep and not row.keep.endswith(".") for row in TABLE.values())


def test_what_results_have_always_kept_is_required():
    assert set(KEPT) >= {"identity", "expression", "albedo", "specular", "roughness"}
    first = ("identity", "expression", "albedo", "specular", "roughness")
    assert all(TABLE[name].required for name in first)


def test_values_without_a_field_go_further():
    found = as_fields(Result, {"identity": 1, "glow": 2})
    assert found == {"identity": 1, "further": {"glow": 2}}


ANOTHER_ROW = """
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract import parameters
from facestage.contract.parameters import Parameter, Values

row = Parameter("Keep the glow", Values((3,), 0, 9), shared=True, required=False)
parameters.TABLE = {**parameters.TABLE, "glow": row}
parameters.KEPT = {**parameters.KEPT, "glow": row.values}

from facestage.contract.person import Person, PersonPhoto
from facestage.contract.result import Result
from fuzz.seeds import contract as seeds_contract

folder = Path(sys.argv[1])
shared = {"identity": np.ones(2), "albedo": np.ones(1), "specular": np.ones((2, 2))}
photo = PersonPhoto(1, "/a.png", "1-a", "converged", "Fine.", True, {})
for further in ({"glow": np.array([1.0, 2, 3])}, {}):
    person = Person(
        status="converged", advice="Fine.", model="default", photos=(photo,), roughness=0.4,
        timings={}, further=further, **shared,
    )
    result = replace(seeds_contract.result(), further=further)
    person.write_into(folder)
    result.write_into(folder)
    for loaded in (Person.load(folder), Result.load(folder)):
        assert set(loaded.further) == set(further), loaded.further
        for name, value in further.items():
            np.testing.assert_array_equal(loaded.further[name], value)
    assert list(Result.load(folder).parameters)[5:] == list(further)
"""


def test_another_row_is_kept_and_what_was_written_before_it_still_loads(
    tmp_path: Path, repository: Path
):
    environment = os.environ | {"PYTHONPATH": str(repository / "tests")}
    command = [sys.executable, "-c", ANOTHER_ROW, str(tmp_path)]
    subprocess.run(command, check=True, timeout=60, env=environment)
