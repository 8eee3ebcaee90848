"""The photos of one person: read one after another, kept small while they are fitted, whole again
at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.job import USUAL_TEXTURE_SIZE, Job
from facestage.contract.person import PHOTOS_MAX
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.runs.member import Member
from facestage.fit.trust.fitted import Fitted
from facestage.models.anatomy.relief import relief_basis

# Of all photos together, so that what is known of each pixel takes less than half a gigabyte.
KEPT_PIXELS = 3_000_000
# What the jobs of one person must agree on, in words.
COMMON = {
    "model": "the face model",
    "freeze": "what is frozen",
    "weights": "the weights",
    "quality": "the quality",
    "plan": "the plan",
    "seed": "the seed",
    "device": "the device",
    "texture_size": "the size of textures",
}


def check_jobs(jobs: Sequence[Job]) -> None:
    """Raise InputError unless the jobs can be of one person."""
    if not 2 <= len(jobs) <= PHOTOS_MAX:
        raise InputError(
            f"{len(jobs)} photo{'' if len(jobs) == 1 else 's'} of one person given; expected 2 to "
            f"{PHOTOS_MAX}. Leave out --same-person for one photo; of many, choose those that "
            "differ most in pose and light."
        )
    if any((job.texture_size or 0) > USUAL_TEXTURE_SIZE for job in jobs):
        raise InputError(
            f"Textures of several photos have {USUAL_TEXTURE_SIZE} pixels at most; ask for no "
            "more, or fit the photos one by one."
        )
    for name, words in COMMON.items():
        for number, job in enumerate(jobs[1:], 2):
            if getattr(job, name) != getattr(jobs[0], name):
                raise InputError(
                    f"The jobs of photos 1 and {number} differ in {words} "
                    f"('{getattr(jobs[0], name)}' and "
                    f"'{getattr(job, name)}'), which photos of one person share; make them equal."
                )
    seen: dict[Path, int] = {}
    for number, job in enumerate(jobs, 1):
        earlier = seen.setdefault(job.image.resolve(), number)
        if earlier != number:
            raise InputError(
                f"Photos {earlier} and {number} are the same file '{job.image}'; give each "
                "photo once."
            )


def read_photos(
    jobs: Sequence[Job],
    emit: Callable[[Event], None],
    landmark_model: Path | None,
    fineness: Fineness = USUAL,
) -> list[Problem]:
    """The problems of all photos at working size, over one face geometry.

    Photos of many megapixels are read again, one at a time, for textures and pictures.
    """
    problems: list[Problem] = []
    geometry: FaceGeometry | None = None
    for number, job in enumerate(jobs, 1):
        try:
            whole = read_problem(job, emit, landmark_model, geometry, fineness)
        except InputError as error:
            raise InputError(
                f"Photo {number} of {len(jobs)} ('{job.image.name}'): {error}"
            ) from error
        if geometry is None:
            geometry = FaceGeometry(whole.geometry.model, relief_basis(whole.geometry.model))
        whole = replace(whole, geometry=geometry)
        # Its job has the landmarks that were found, for when the photo is read again.
        problems.append(whole.reduced(fineness.joint_face_px))
    return problems


class OwnSizes:
    """The photos of the members at their own sizes, which textures and pictures are made at."""

    def __init__(self, kept_pixels: int = KEPT_PIXELS) -> None:
        """Problems of so many pixels together are kept."""
        self._kept: dict[int, Problem] = {}
        self._pixels_left = kept_pixels

    def of(self, member: Member, fitted: Fitted) -> tuple[Problem, Fitted]:
        """A member's problem and fit. Finding skin and hair takes a second or two, so problems of
        small photos are kept.
        """
        problem = self._kept.get(member.number) or self._read(member)
        if problem.camera.width == member.problem.camera.width:
            return problem, fitted
        focal_px = fitted.state.camera.focal_px / problem.scale(problem.fineness.joint_face_px)
        state = replace(fitted.state, camera=replace(problem.camera, focal_px=focal_px))
        return problem, fitted.in_size(state, *problem.photograph.size)

    def _read(self, member: Member) -> Problem:
        small = member.problem
        problem = read_problem(small.job, geometry=small.geometry, fineness=small.fineness)
        problem = problem.lit_as(small)
        pixels = problem.photograph.mask.size
        if pixels <= self._pixels_left:
            self._pixels_left -= pixels
            self._kept[member.number] = problem
        return problem


def face_px(member: Member) -> float:
    """The face's size in pixels of the photo at its own size."""
    given = member.problem.job.landmarks
    assert given is not None
    return face_size_px(member.problem.window.landmarks(given))
