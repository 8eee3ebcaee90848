"""A film of the synthetic face that turns, talks and blinks, and what a network would find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.files.color import linear_to_srgb
from facestage.contract.files.storage import write_arrays
from facestage.fit.face.state import State
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.sightings import Sightings
from facestage.images.film import Film
from facestage.images.image_io import write_png
from facestage.landmarks.tracker import Sight
from reference.synthetic_scene import Scene, synthetic_scene

FRAMES, SIDE = 13, 80


@dataclass(frozen=True)
class SmallFilm:
    """The files of a film, and the truth about it."""

    folder: Path
    scene: Scene
    states: list[State]
    model: Path

    def request(self, **changes: Any) -> Request:
        """What asks for it."""
        camera = self.scene.state.camera
        known: dict[str, Any] = {
            "film": self.folder,
            "model": f"npz:{self.model}",
            "camera": camera,
        }
        return Request(**(known | changes))

    def write_truth(self, path: Path) -> Path:
        """The vertices of every frame, in metres."""
        vertices = [
            self.scene.geometry.at(state) @ state.rotation.T + state.translation
            for state in self.states
        ]
        whole = np.zeros((FRAMES, len(self.scene.model.vertices), 3))
        whole[:, self.scene.geometry.used] = vertices
        weights = np.array([state.expression for state in self.states])
        names = np.array(self.scene.model.expression_names)
        write_arrays(path, {"vertices": whole, "expression": weights, "names": names})
        return path

    def looker(self, lost: tuple[int, ...] = ()) -> Callable[..., Sightings]:
        """In place of ``look_through``: the true landmarks, none in the ``lost`` frames."""

        def look(film: Film, found: Sightings, *rest: Any) -> Sightings:
            keep, tell = rest[-2:]
            for frame in film.frames(len(found)):
                points = self.scene.landmarks(self.states[frame.index], 0.3, frame.index).points
                gone = frame.index in lost
                found.scheme, found.size = "ibug68", frame.photograph.size
                found.numbers.append(frame.number)
                found.times.append(frame.time)
                found.names.append(frame.name)
                found.points.append(points * np.nan if gone else points)
                found.visible.append(np.full(len(points), not gone))
                found.confidence.append(float(not gone))
                found.sights.append(Sight.LOST if gone else Sight.TRACKED)
                tell(found)
            keep(found)
            return found

        return look


def small_film(folder: Path) -> SmallFilm:
    """Written into ``folder``."""
    scene = synthetic_scene(side=SIDE)
    states = []
    (folder / "frames").mkdir()
    for index in range(FRAMES):
        phase = 2 * np.pi * index / (FRAMES - 1)
        turn = Rotation.from_rotvec([0.08 * np.sin(phase), 0.3 * np.cos(phase), 0.0])
        blink = max(0.0, 1.0 - 0.5 * abs(index - 6))
        expression = np.array([0.3 + 0.25 * np.sin(phase), 0.3 + 0.2 * np.cos(phase), 0.7 * blink])
        state = replace(scene.state, rotation=turn.as_matrix(), expression=expression)
        states.append(state)
        color, _ = scene.render(state, samples=8)
        pixels = np.round(255 * linear_to_srgb(np.clip(color / color.max(), 0, 1)))
        write_png(folder / "frames" / f"{index + 1:03d}.png", pixels.astype(np.uint8))
    model = folder / "model.npz"
    scene.model.save(model)
    return SmallFilm(folder / "frames", scene, states, model)
