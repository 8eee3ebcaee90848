"""What a fit needs to go on after it was stopped: written after every step, whole or not at all."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.storage import finite, read_arrays, write_arrays
from facestage.fit.parameters import State

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

    def save(self, folder: Path) -> None:
        """Write the checkpoint into ``folder``, replacing the previous one."""
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
        write_arrays(folder / FILE, arrays, compress=False)

    @classmethod
    def load(cls, folder: Path) -> Checkpoint | None:
        """The checkpoint in ``folder``, or None when there is none."""
        if not (folder / FILE).is_file():
            return None
        arrays = read_arrays(folder / FILE, "checkpoint")
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
            raise InputError(
                f"The checkpoint in '{folder}' is damaged ({error}); start again without --resume."
            ) from error


_STATE_ARRAYS = ("rotation", "translation", "identity", "expression", "lights", "light_position", "albedo", "specular")
