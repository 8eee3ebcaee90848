"""What a fit needs to go on after it was stopped: written after every step, whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.storage import finite, read_arrays, write_arrays
from facestage.fit.parameters import State
from facestage.fit.schedule import Stage
from facestage.fit.solver import Damping
from facestage.fit.view import View

FILE = "checkpoint.npz"


@dataclass(frozen=True)
class Checkpoint:
    """The state after ``step`` accepted steps of phase number ``phase``, and what the rest depends on."""

    fingerprint: str  # of the job; a checkpoint of another job must not be continued
    phase: int
    step: int
    damping: tuple[float, float]
    light_scale: float
    seconds: float
    camera_to_stage: np.ndarray  # (4, 4)
    strong: np.ndarray  # (N,) bool, the lights whose position is fitted
    state: State
    trace: list[dict[str, Any]]
    resting: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))  # (N,) lights that rest; none when empty
    hidden: np.ndarray | None = None  # (h, w) bool at the size of the first photo phase
    casting: np.ndarray | None = None  # (N,) bool, lights whose shadows the phase follows as they move

    @classmethod
    def of(
        cls, view: View, phase: int, step: int, damping: Damping, seconds: float, state: State,
        trace: list[dict[str, Any]], stage: Stage | None,
    ) -> Checkpoint:  # fmt: skip
        """What ``view`` and the phase's ``stage``, if it takes part in it, remember after ``step``."""
        anchor = view.camera_to_stage if view.camera_to_stage is not None else np.full((4, 4), np.nan)
        return cls(
            view.problem.fingerprint, phase, step, (damping.value, damping.growth), view.light_scale, seconds, anchor,
            view.strong, state, trace, np.zeros(0, bool) if stage is None else stage.resting, view.visible.hidden,
            None if stage is None or stage.energy.photo is None else stage.energy.photo.casting,
        )  # fmt: skip

    def restore(self, view: View) -> None:
        """Let ``view`` remember again what it did."""
        view.light_scale, view.strong, view.visible.hidden = self.light_scale, self.strong, self.hidden
        if np.isfinite(self.camera_to_stage).all():
            view.camera_to_stage = self.camera_to_stage

    def restore_stage(self, stage: Stage) -> None:
        """The same for the stage of the phase that was left in the middle."""
        if stage.energy.photo is not None:
            stage.energy.photo.resting = self.resting if len(self.resting) else None
            stage.energy.photo.casting = self.casting

    def arrays(self) -> dict[str, np.ndarray]:
        """The checkpoint as named arrays."""
        meta = {
            "fingerprint": self.fingerprint, "phase": self.phase, "step": self.step, "damping": self.damping,
            "light_scale": self.light_scale, "seconds": self.seconds, "camera": self.state.camera.to_json(),
            "roughness": self.state.roughness, "trace": self.trace,
        }  # fmt: skip
        arrays = {name: getattr(self.state, name) for name in _STATE_ARRAYS}
        arrays |= {
            "resting": self.resting, "strong": self.strong, "camera_to_stage": self.camera_to_stage,
            "meta": np.array(json.dumps(finite(meta))),
        }  # fmt: skip
        for name in ("hidden", "casting"):
            if getattr(self, name) is not None:
                arrays[name] = getattr(self, name)
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], folder: Path) -> Checkpoint:
        """The reverse of :meth:`arrays`; ``folder`` is named when something is missing."""
        try:
            meta = json.loads(str(arrays["meta"]))
            state = State(
                camera=Camera.from_json(meta["camera"]), roughness=float(meta["roughness"]),
                **{name: arrays[name] for name in _STATE_ARRAYS},
            )  # fmt: skip
            return cls(
                meta["fingerprint"], meta["phase"], meta["step"], tuple(meta["damping"]), meta["light_scale"],
                meta["seconds"], arrays["camera_to_stage"], arrays["strong"], state, meta["trace"],
                arrays["resting"], arrays.get("hidden"), arrays.get("casting"),
            )  # fmt: skip
        except (KeyError, ValueError, TypeError) as error:
            raise damaged(folder, error) from error

    def save(self, folder: Path) -> None:
        """Write the checkpoint into ``folder``, replacing the previous one."""
        write_arrays(folder / FILE, self.arrays(), compress=False)

    @classmethod
    def load(cls, folder: Path) -> Checkpoint | None:
        """The checkpoint in ``folder``, or None when there is none."""
        if not (folder / FILE).is_file():
            return None
        return cls.from_arrays(read_arrays(folder / FILE, "checkpoint"), folder)

    def check_fingerprint(self, fingerprint: str, folder: Path) -> None:
        """Raise InputError when the checkpoint belongs to another job than the one of this ``fingerprint``."""
        if self.fingerprint != fingerprint:
            raise InputError(
                f"The checkpoint in '{folder}' belongs to another job (photo, landmarks or options differ); "
                "start again without --resume, or restore the options."
            )


def damaged(folder: Path, error: Exception) -> InputError:
    """What is said of a checkpoint that cannot be understood."""
    return InputError(f"The checkpoint in '{folder}' is damaged ({error}); start again without --resume.")


_STATE_ARRAYS = ("rotation", "translation", "identity", "expression", "lights", "light_position", "albedo", "specular")
