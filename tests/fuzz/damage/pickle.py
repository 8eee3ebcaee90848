"""Damage to pickles: opcodes that go, come and change, memo bombs, and names that must not be
looked up.
"""

from __future__ import annotations

import pickletools
import struct

from fuzz.choice import Choose
from fuzz.damage.bytes import mangle_bytes

_HARMFUL = (
    b"cos\nsystem\n(S'true'\ntR",
    b"cbuiltins\neval\n(S'1'\ntR",
    b"cnumpy\nload\n(S'x'\ntR",
    b"\x8c\x02os\x8c\x06system\x93",
    b"cbuiltins\ngetattr\n",
    b"c__builtin__\nobject\n)R",
    b"cnumpy\nndarray\n(I99999999999\ntR",
    b"P7\n",
    b"Q",
    b"\x82\x01",
    b"cscipy.sparse.csc\ncsc_matrix\n)\x81}b",
    b"cnumpy\ndtype\n(S'O8'\nI0\nI1\ntR",
    b"ccollections\nOrderedDict\n)R",
    b"cchumpy.ch\nCh\n)\x81}b",
    b"cchumpy.ch\nCh\n)R",
    b"cnumpy.core.multiarray\n_reconstruct\n)R",
    b"c_codecs\nencode\n)R",
    b"cnumpy.core.multiarray\nscalar\n)R",
    b"ccopy_reg\n_reconstructor\n)R",
)
_LENGTHS = (
    b"r\xff\xff\xff\x7f",
    b"r\xff\xff\xff\xff",
    b"X\xff\xff\xff\x7f",
    b"B\xff\xff\xff\x7f",
    b"T\xff\xff\xff\x7f",
    b"\x8d" + struct.pack("<Q", 2**62),
    b"\x8e" + struct.pack("<Q", 2**40),
    b"\x8b" + struct.pack("<I", 2**31 - 1),
    b"\x95" + struct.pack("<Q", 2**62),
    b"p999999999999\n",
    b"I" + b"9" * 6000 + b"\n",
    b"\x96" + struct.pack("<Q", 2**45),
    b"L" + b"9" * 100_000 + b"L\n",
    b"\x8b\xa0\x86\x01\x00" + b"\xff" * 100_000,
)
_PLAIN = tuple(
    bytes([code]) for code in b"().012NRabdeilostu]}\x81\x85\x86\x87\x88\x89\x8f\x90\x91\x94"
)


def mangle_pickle(choose: Choose, data: bytes) -> bytes:
    """A pickle with one to three changes between its opcodes, or plain damage."""
    header = data.find(b"\n") + 1 if data.startswith(b"\x93NUMPY") else 0
    start, body = data[:header], data[header:]
    for _ in range(choose.one_of((1, 1, 2, 3))):
        body = _changed(choose, body)
    return start + body


def _changed(choose: Choose, data: bytes) -> bytes:
    places = _places(data)
    if len(places) < 3 or choose.chance(4):
        return mangle_bytes(choose, data)
    number = choose.number(0, len(places) - 2)
    here, following = places[number], places[number + 1]
    kind = choose.number(0, 6)
    if kind == 0:
        return data[:here] + data[following:]
    if kind == 1:
        return data[:following] + data[here:]
    if kind == 2:
        return data[:here] + choose.one_of(_PLAIN) + data[here + 1 :]
    if kind == 3:
        return data[:here] + choose.one_of(_PLAIN) + data[here:]
    if kind == 4:
        return data[:here] + choose.one_of(_HARMFUL) + data[here:]
    if kind == 5:
        return data[:here] + choose.one_of(_LENGTHS) + data[here:]
    if choose.chance(2):
        return data[:here] + _shared(choose) + data[here:]
    return data[:here] + _nested(choose) + data[here:]


def _places(data: bytes) -> list[int]:
    """Where the opcodes start; as far as the pickle can be followed."""
    found: list[int] = []
    try:
        for _, _, place in pickletools.genops(data):
            found.append(place or 0)
            if len(found) > 4000:
                break
    # pickletools raises what it likes for a pickle that was damaged before.
    except Exception:  # noqa: BLE001
        return found
    return found


def _shared(choose: Choose) -> bytes:
    """A list that holds one list several times, which holds one list several times, ..."""
    opening, closing = choose.one_of(((b"]", b"e"), (b"", b"t"), (b"}", b"u")))
    code = b"N"
    for level in range(choose.one_of((5, 30, 60))):
        slot = bytes([200 + level % 40])
        code += (
            b"q" + slot + b"0" + opening + b"(" + (b"h" + slot) * choose.one_of((2, 10)) + closing
        )
    return code


def _nested(choose: Choose) -> bytes:
    depth = choose.one_of((100, 1500, 100_000))
    return choose.one_of((b"]" * depth + b"a" * (depth - 1), b")" + b"\x85" * depth, b"(" * depth))
