"""How fine a fit is: what a job asks for, and what a draft shows at most."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from facestage.contract.job import Job
from facestage.contract.quality import DRAFT
from facestage.fit.given.fineness import TEXELS_PER_FACE_PX, USUAL
from facestage.fit.textures.refine import texture_size

DRAFTED = Job(Path("photo.png"), quality=DRAFT)


def test_a_draft_s_face_fills_its_textures_and_no_more():
    draft = USUAL.of(DRAFTED)
    assert texture_size(5000.0, draft) == USUAL.draft_texture < USUAL.texture_max
    assert draft.face_px == draft.whole_face_px == USUAL.draft_texture / TEXELS_PER_FACE_PX
    # So no finer photo is read for them.
    assert draft.painted_face_px == draft.face_px
    assert draft.relief_texture < USUAL.relief_texture and draft.picture_rays < USUAL.picture_rays


@pytest.mark.parametrize("texels", [512, 1024, 2048, 4096])
def test_a_draft_has_the_texels_that_were_asked_for(texels: int):
    draft = USUAL.of(replace(DRAFTED, texture_size=texels))
    assert texture_size(5000.0, draft) == texels
    assert draft.painted_face_px >= texels / TEXELS_PER_FACE_PX
    assert draft.whole_face_px >= USUAL.of(DRAFTED).whole_face_px


def test_what_a_job_asked_for_is_asked_for_once():
    for texels in (None, 512, 4096):
        for quality in ("good", DRAFT):
            job = replace(DRAFTED, texture_size=texels, quality=quality)
            assert USUAL.of(job).of(job) == USUAL.of(job)
