"""Every frame belongs to one piece, whose neighbours look at it, too."""

from __future__ import annotations

import pytest

from facestage.fit.pieces.cutting import cut


@pytest.mark.parametrize(
    ("count", "most", "pieces"), [(48, 24, 2), (49, 24, 3), (24, 24, 1), (5, 2, 3)]
)
def test_a_film_is_cut_into_even_pieces(count: int, most: int, pieces: int):
    found = cut(count, most, overlap=3)
    assert len(found) == pieces and len({piece.name for piece in found}) == pieces
    frames = list(range(count))
    assert [frame for piece in found for frame in frames[piece.own]] == frames
    sizes = [piece.end - piece.first for piece in found]
    assert max(sizes) <= most and max(sizes) - min(sizes) <= 1
    for piece in found:
        assert frames[piece.looked_at][piece.inside] == frames[piece.own]
        assert piece.start == max(piece.first - 3, 0) and piece.stop == min(piece.end + 3, count)
