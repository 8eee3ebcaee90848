"""The files of a result folder and of a person's folder: whatever else lies there is the user's,
and stays.
"""

from __future__ import annotations

import re
from pathlib import PurePath

from facestage.contract import person
from facestage.contract.result import COVERAGE, PICTURES, ROUGHNESS

RESULT, LANDMARKS, REPORT = "result.json", "landmarks.json", "report.html"
FILES = frozenset(
    {
        RESULT,
        "result.npz",
        "job.json",
        "job.npz",
        LANDMARKS,
        "trace.jsonl",
        "relight.npz",
        REPORT,
        *PICTURES,
        ROUGHNESS,
        COVERAGE,
        person.FILE,
        "person.html",
    }
)
REPORT_PICTURES = frozenset(
    {
        "albedo",
        "certainty",
        "comparison",
        "face",
        "face_photo",
        "landmarks",
        "light_probe",
        "person",
        "roughness",
        "specular",
        "texture_coverage",
        "trace",
        "weights",
    }
)
RELIT = re.compile(r"relit_\w+\.png")
PHOTO_FOLDER = re.compile(rf"[1-{person.PHOTOS_MAX}]-.+", re.DOTALL)


def is_result_file(path: PurePath) -> bool:
    """Whether Facestage writes a file of this path, relative to a result's folder or a person's."""
    if len(path.parts) == 2 and PHOTO_FOLDER.fullmatch(path.parts[0]):
        path = PurePath(path.name)
    if len(path.parts) != 1:
        return False
    name = path.name
    return (
        name in FILES
        or (path.suffix == ".png" and path.stem in REPORT_PICTURES)
        or bool(RELIT.fullmatch(name))
    )
