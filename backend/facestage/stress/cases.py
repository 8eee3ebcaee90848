"""All stress cases by name, in the order of the table."""

from facestage.stress import camera_cases, face_cases, landmark_cases, light_cases, photo_cases
from facestage.stress.case import Case

CASES: dict[str, Case] = {
    name: case
    for module in (light_cases, face_cases, photo_cases, landmark_cases, camera_cases)
    for name, case in module.suite.cases.items()
}
