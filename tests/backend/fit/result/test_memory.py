"""A picture that the machine has no memory for is refused before it is made."""

from __future__ import annotations

import pytest

from facestage.contract.errors import InputError
from facestage.fit.result.memory import BYTES_PER_PIXEL, check_picture, machine_memory


def test_a_picture_beyond_the_memory_is_refused_with_both_figures():
    with pytest.raises(
        InputError, match=r"16384 x 8192 pixels takes about 8 GiB of memory, this machine has 4 GiB"
    ):
        check_picture(16384, 8192, 4 * 2**30)


def test_a_picture_that_fits_passes_also_where_nobody_knows():
    check_picture(4096, 4096, 4096 * 4096 * BYTES_PER_PIXEL)
    check_picture(16384, 8192, None)


def test_this_machine_has_some():
    memory = machine_memory()
    assert memory is None or memory > 2**28
