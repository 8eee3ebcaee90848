"""Photographs of a scan of the user's: the ``--scan`` family of the cases."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.case_files import LANDMARKS, PHOTO
from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.contract.scan import face_numbers, read_region

from ..backend.commands import detect_command, find_backend
from ..pictures.render import save_png, srgb
from ..synthetic.scans.face_region import face_vertices
from ..synthetic.scans.head import ScannedHead, read_head
from ..synthetic.scans.light import read_surroundings
from ..synthetic.scans.photograph import (
    DISTANCE_MM,
    FOCAL_SHARE,
    Pose,
    Quality,
    Shot,
    exposed,
    middle_of,
    photograph_scan,
    picture_of,
    posed,
)
from ..synthetic.scans.skin import SkinMaps
from . import pipeline
from .scan_options import LIGHTS, TURN_MAX

FRONTAL = Quality(256, samples=8)  # of the picture in which the face is found
ROOM = 1.1  # of the scan's size, what that picture shows at least


def make_scan_cases(options: argparse.Namespace) -> None:
    """Photograph the scan, each photo into a folder of its own, written whole.

    Raises InputError, before anything is written where it is about the options.
    """
    poses = read_poses(options.scan_yaw, options.scan_pitch)
    lights = [read_surroundings(text) for text in options.scan_light or LIGHTS]
    scene = pipeline.empty_scene()
    head = read_head(options.scan, options.scan_units, options.scan_facing, options.scan_up)
    maps = SkinMaps(options.scan_color, options.scan_normal)
    if not head.has_uvs and maps != SkinMaps():
        raise InputError(
            f"The scan '{options.scan}' has no texture coordinates (vt), which the picture of "
            "--scan-color or --scan-normal lies over; export it with UVs, or leave the picture out."
        )
    if options.face_region is None:
        face = found_face(scene, head, Shot(lights[0], maps, FRONTAL))
    else:
        face = given_face(options.face_region, head, options.scan)
    quality = Quality(options.size, options.samples, options.seed)
    for number in range(max(len(poses), len(lights))):
        started = time.monotonic()
        light, pose = lights[number % len(lights)], poses[number % len(poses)]
        name = f"{number + 1}-{light.name}"
        shot = Shot(light, maps, quality)
        photograph_scan(scene, head, face, pose, shot, options.out.resolve() / name)
        print(f"{name:<20}{time.monotonic() - started:5.1f} s", flush=True)


def read_poses(yaws: Sequence[float], pitches: Sequence[float]) -> list[Pose]:
    """The poses of the photos, of which the shorter list repeats. Raises InputError."""
    for angle in (*yaws, *pitches):
        if not abs(angle) <= TURN_MAX:
            raise InputError(
                f"A head turned by {angle:g} degrees shows too little of its face; --scan-yaw and "
                f"--scan-pitch go from -{TURN_MAX:g} to {TURN_MAX:g}."
            )
    count = max(len(yaws), len(pitches))
    return [Pose(yaws[k % len(yaws)], pitches[k % len(pitches)]) for k in range(count)]


def given_face(region: Path, head: ScannedHead, scan: Path) -> np.ndarray:
    """(f,) numbers of the vertices that a file says are the face. Raises InputError."""
    if not head.complete:
        raise InputError(
            f"The scan '{scan}' has vertices that no face uses, which are left out, so the numbers "
            "of --face-region are not its own; remove loose vertices, or leave --face-region out."
        )
    return read_region(region, len(head.vertices))


def found_face(scene: bpy.types.Scene, head: ScannedHead, shot: Shot) -> np.ndarray:
    """(f,) numbers of the vertices that a camera in front of the head sees within the landmarks
    that the backend finds there. Raises InputError.
    """
    size = float(np.ptp(head.vertices, axis=0).max())
    away = max(DISTANCE_MM, ROOM * FOCAL_SHARE * size)
    vertices = posed(head.vertices, middle_of(head.vertices), Pose(), away)
    picture = exposed(picture_of(scene, head, vertices, shot), np.s_[:])
    with tempfile.TemporaryDirectory() as folder:
        photo, points = Path(folder) / PHOTO, Path(folder) / LANDMARKS
        save_png(photo, srgb(picture))
        try:
            pipeline.run_backend(detect_command(find_backend(), photo, points), lambda _event: None)
        except InputError as error:
            raise InputError(
                f"No face was found in a picture of the scan from the front ({error}); check "
                "--scan-facing and --scan-up, or give --face-region."
            ) from error
        landmarks = Landmarks.read(points).points
    return face_numbers(
        face_vertices(vertices, head.triangles, shot.quality.camera, landmarks),
        len(vertices),
        "The face found in a picture of the scan from the front",
    )
