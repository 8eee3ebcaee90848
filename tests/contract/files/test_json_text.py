"""JSON text within limits: what is refused, in how many words, and that nothing else is."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.contract.errors import InputError
from facestage.contract.files.json_text import DEPTH_MAX, JSON_MAX, decode_json, depth
from facestage.contract.files.storage import read_json


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[" * 1_000_000, "more than 64 deep"),
        (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, "more than 64 deep"),
        (b"[" * (DEPTH_MAX + 1) + b"]" * (DEPTH_MAX + 1), "more than 64 deep"),
        (b"9" * 5000, "4300"),
        (b'{"a": NaN}', "NaN is no number"),
        (b'{"a": -Infinity}', "-Infinity is no number"),
        (b'{"a": 1, "b": 2, "a": 3}', "'a' is there twice"),
        (b'{"\\u001b": 1, "\\u001b": 3}', r"'.x1b' is there twice"),
        (b"\xff\xfe{}", "not UTF-8 at byte 0"),
        (b'"' + b"x" * JSON_MAX + b'"', "expected at most 16"),
        (b"", "Expecting value"),
        (b"{}{}", "Extra data"),
    ],
)
def test_what_is_refused(content: bytes, words: str, tmp_path: Path):
    with pytest.raises(ValueError, match=words):
        decode_json(content)
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_json(tmp_path / "a.json", "camera file")
    assert (
        str(caught.value).isprintable()
        and len(str(caught.value)) < 500
        and "a.json" in str(caught.value)
    )


def test_a_mark_at_the_beginning_and_deep_values_within_the_limit_are_read():
    assert decode_json(b'\xef\xbb\xbf{"a": 1}') == {"a": 1}
    deepest = b"[" * DEPTH_MAX + b"]" * DEPTH_MAX
    assert depth(deepest) == DEPTH_MAX and isinstance(decode_json(deepest), list)


@given(st.lists(st.text() | st.lists(st.text(), max_size=3), max_size=5), st.booleans())
def test_brackets_in_text_are_not_counted(data: list, ascii_only: bool):
    content = json.dumps(data, ensure_ascii=ascii_only).encode(errors="surrogatepass")
    assert depth(content) == 1 + any(isinstance(item, list) for item in data)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes are of Unix")
def test_pipes_and_devices_are_refused_unread(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.json")
    for path in (tmp_path / "pipe.json", Path("/dev/zero")):
        with pytest.raises(InputError, match="a pipe or a device, expected a file"):
            read_json(path, "camera file")


def test_text_of_the_largest_size_and_values_without_depth_are_read():
    assert decode_json(b'"' + b"x" * (16 * 2**20 - 2) + b'"') == "x" * (16 * 2**20 - 2)
    assert depth(b"") == depth(b"5") == depth(b'"[{"') == 0 and decode_json(b"5") == 5
    assert depth(b"[{}, [], {}]") == depth(b"{}") + 1 == 2
    assert depth(b'[[1, "]]"], {"[": [[]]}]') == 4, "the deepest comes last"


def test_only_a_key_that_is_there_twice_is_refused():
    assert decode_json(b'{"a": {"a": 1}, "b": {"a": 2}}') == {"a": {"a": 1}, "b": {"a": 2}}
    with pytest.raises(ValueError, match="'b' is there twice"):
        decode_json(b'{"a": 1, "b": 2, "b": 2, "c": 3}')
