"""The files of a result folder, of a person's and of a sequence's: whatever else lies there is the
user's, and stays.
"""

from __future__ import annotations

import re
from pathlib import PurePath

from facestage.contract import job, person, result, sequence, wrinkles
from facestage.contract.relight_cache import RELIGHT_CACHE
from facestage.contract.texture_maps import BESIDE_MAPS, TEXTURE_MAPS

RESULT, LANDMARKS, REPORT = result.FILE, "landmarks.json", "report.html"
SEQUENCE_PICTURE, SEQUENCE_FILM = "sequence.png", "film.webp"
WRINKLES_PICTURE = "wrinkles.png"
TRACE, PERSON_REPORT, PERSON_PICTURE = "trace.jsonl", "person.html", "person.png"
FILES = frozenset(
    {
        RESULT,
        result.ARRAYS,
        job.FILE,
        job.ARRAYS,
        LANDMARKS,
        TRACE,
        RELIGHT_CACHE,
        REPORT,
        *result.PICTURES,
        *(each.file for each in TEXTURE_MAPS),
        *(each.file for each in BESIDE_MAPS),
        result.COVERAGE,
        person.FILE,
        PERSON_REPORT,
        PERSON_PICTURE,
        sequence.FILE,
        sequence.ARRAYS,
        sequence.VERTICES,
        sequence.LIVE_LINK,
        SEQUENCE_PICTURE,
        SEQUENCE_FILM,
        WRINKLES_PICTURE,
    }
)
REPORT_PICTURES = frozenset(
    {
        *(each.name for each in TEXTURE_MAPS),
        "certainty",
        "comparison",
        "curves",
        "face",
        "face_photo",
        "landmarks",
        "light_probe",
        "texture_coverage",
        "trace",
        "weights",
    }
)
KEYFRAME_PICTURE = re.compile(r"frame-\d+\.png")
RELIT = re.compile(r"relit_\w+\.png")
PHOTO_FOLDER = re.compile(rf"[1-{person.PHOTOS_MAX}]-.+", re.DOTALL)


def is_result_file(path: PurePath) -> bool:
    """Whether Facestage writes a file of this path, relative to a result's folder, a person's or a
    sequence's.
    """
    if len(path.parts) > 1 and path.parts[0] == sequence.KEYFRAMES:
        path = PurePath(*path.parts[1:])
    if len(path.parts) == 2 and PHOTO_FOLDER.fullmatch(path.parts[0]):
        path = PurePath(path.name)
    if len(path.parts) != 1:
        return False
    name = path.name
    return (
        name in FILES
        or (path.suffix == ".png" and path.stem in REPORT_PICTURES)
        or bool(RELIT.fullmatch(name))
        or bool(wrinkles.FILE.fullmatch(name))
        or bool(KEYFRAME_PICTURE.fullmatch(name))
    )
