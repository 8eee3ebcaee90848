"""What was found, in words: each kind of value, and where they are cut."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from facestage.contract.wording import escaped, one_line, quoted, shown, whole_bytes


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "null"),
        (True, "true"),
        (False, "false"),
        (0, "0"),
        (-5, "-5"),
        (0.5, "0.5"),
        ("a\nb", r"'a\nb'"),
        (2**128 - 1, "340282366920938463463374607431768211455"),
        (2**128, "a number of 129 bits"),
        ({"a": 1, "b": 2}, "an object of 2 keys"),
        ([1, 2, 3], "a list of 3"),
        ((), "a list of 0"),
        (np.zeros((2, 1), np.float32), "an array of shape (2, 1) of float32"),
        (b"x" * 100, "b'" + "x" * 58),
        (b"\n", r"b'\n'"),
        (SimpleNamespace(shape=3), "namespace(shape=3)"),
    ],
)
def test_a_value_in_words(value: object, words: str):
    assert shown(value) == words


def test_text_of_sixty_characters_is_quoted_whole():
    assert quoted("x" * 60) == f"'{'x' * 60}'"
    assert quoted("x" * 61) == f"'{'x' * 60}...' (61 characters)"
    assert quoted("\t" * 61) == "'" + 60 * r"\t" + "...' (61 characters)"


def test_only_what_cannot_be_printed_is_escaped():
    assert escaped("ä b") == "ä b"
    assert escaped("ä\x1b[31m\u2028\ud800") == r"ä\x1b[31m\u2028\ud800"


def test_a_sentence_becomes_one_line_without_its_middle():
    assert one_line("a\nb\nc\td") == r"a b c\td"
    whole = "".join(chr(97 + number % 26) for number in range(901))
    assert one_line(whole[:900]) == whole[:900]
    assert one_line(whole) == f"{whole[:600]} ... {whole[601:]}"


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 bytes"),
        (1023, "1023 bytes"),
        (1024, "1 KiB"),
        (1536, "1.5 KiB"),
        (2**20 - 1024, "1023 KiB"),
        (2**20, "1 MiB"),
        (2**30, "1 GiB"),
        (3 * 2**39, "1.5 TiB"),
        (2**50, "1024 TiB"),
    ],
)
def test_bytes_in_the_unit_that_one_would_use(count: int, words: str):
    assert whole_bytes(count) == words
