"""What a fit needs to go on after it was stopped: written after every step, whole or not at all.

A checkpoint holds where the last accepted step began. It is taken again, so that what follows from
it (the normal equations, the model's answer, whether the phase is over) is known as if nothing had
happened; and all that a phase prepares before its first step is prepared again from what it was
prepared from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.partial import CHECKPOINT
from facestage.contract.files.storage import finite as finite_json
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.schemas.schema import checked, decoded_meta, sections
from facestage.fit.energy.plan import Ledger, Work
from facestage.fit.face.state import State
from facestage.fit.runs.checkpoint_schema import (
    CheckpointArrays,
    finite,
    state_of,
    state_to_arrays,
    state_to_meta,
)
from facestage.fit.stages.passage import Within
from facestage.fit.stages.phases import PHASES, Schedule
from facestage.fit.stages.skin_to_skin import SkinToSkin
from facestage.fit.stages.surround import Surround
from facestage.fit.stages.view import Memory, View

SCHEMA_VERSION = 2
AGAIN = "start again without --resume"
# How a file of this version names the phases.
_NUMBERS = {phase.name: number for number, phase in enumerate(PHASES)}
_NAMES = {number: str(name) for name, number in _NUMBERS.items()}


@dataclass(frozen=True)
class Checkpoint:
    """Where the phase called ``phase`` of a photo began, and how far it was."""

    fingerprint: str  # of the job; a checkpoint of another job must not be continued
    phase: str
    seconds: float
    start: State | None  # where the landmark phases ended, once they have
    began: State  # where the phase began, at the photo's full size
    memory: Memory  # of the view, there
    ledger: Ledger
    trace: list[dict[str, Any]]
    within: Within | None = None  # None before its first step, and for a photo that takes no part

    @classmethod
    def of(
        cls,
        view: View,
        phase: str,
        seconds: float,
        start: State | None,
        state: State,
        trace: list[dict[str, Any]],
    ) -> Checkpoint:
        """Before anything of the phase is done."""
        return cls(
            view.problem.fingerprint,
            phase,
            seconds,
            start,
            state,
            view.memory,
            deepcopy(view.plan.ledger),
            list(trace),
        )

    def after(
        self, within: Within, view: View, seconds: float, trace: list[dict[str, Any]]
    ) -> Checkpoint:
        """The same phase after some steps."""
        return replace(
            self,
            within=within,
            ledger=deepcopy(view.plan.ledger),
            seconds=seconds,
            trace=list(trace),
        )

    def with_relief(self, count: int) -> Checkpoint:
        """See :meth:`JointCheckpoint.with_relief`."""

        def completed(state: State) -> State:
            return state if len(state.relief) else replace(state, relief=np.zeros(count))

        within = self.within
        return replace(
            self,
            began=completed(self.began),
            start=None if self.start is None else completed(self.start),
            within=None if within is None else replace(within, state=completed(within.state)),
        )

    def restored(self, view: View) -> View:
        """``view``, with the lights that had joined it, remembering what it did where the phase
        began.
        """
        if self.memory.exposure != 1.0:
            view = view.exposed(self.memory.exposure)
        if self.memory.surround is not None and self.memory.surround.joined:
            view = view.lit_from_behind(self.memory.surround.lights)
        view.memory = self.memory
        view.plan.ledger.set_to(self.ledger)
        return view

    def arrays(self) -> dict[str, np.ndarray]:
        """The checkpoint as named arrays."""
        within = self.within
        states = {
            "began": self.began,
            "start": self.start,
            "within": None if within is None else within.state,
        }
        meta = {
            "schema": SCHEMA_VERSION,
            "fingerprint": self.fingerprint,
            "phase": _NUMBERS[self.phase],
            "seconds": self.seconds,
            "trace": self.trace,
            "ledger": ledger_to_json(self.ledger),
            "light_scale": self.memory.light_scale,
            "penumbra": self.memory.penumbra,
            "exposure": self.memory.exposure,
            "surround": None if self.memory.surround is None else vars(self.memory.surround),
            "between": None if self.memory.between is None else vars(self.memory.between),
            "within": None if within is None else {"step": within.step, "damping": within.damping},
            "states": {
                name: state_to_meta(state) for name, state in states.items() if state is not None
            },
        }
        arrays = {"meta": np.array(json.dumps(finite_json(meta))), "strong": self.memory.strong}
        for name, state in states.items():
            if state is not None:
                own = state_to_arrays(state)
                arrays |= {f"{name}/{field}": array for field, array in own.items()}
        optional = {
            "camera_to_stage": self.memory.camera_to_stage,
            "hidden": self.memory.hidden,
            "dark": self.memory.dark,
            "resting": None if within is None else within.resting,
        }
        return arrays | {name: array for name, array in optional.items() if array is not None}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], folder: Path) -> Checkpoint:
        """The reverse of :meth:`arrays`; ``folder`` is named when something is missing."""
        subject = f"The checkpoint in '{folder}'"
        meta = decoded_meta(str(arrays.get("meta")), subject, AGAIN)
        if meta.get("schema") != SCHEMA_VERSION:
            raise other_version(folder)
        given = checked(
            CheckpointArrays(), sections(arrays, "began", "start", "within"), subject, AGAIN
        )
        try:
            states = {name: state_of(own, given[name]) for name, own in meta["states"].items()}
            memory = Memory(
                finite(meta["light_scale"]),
                None if meta["penumbra"] is None else finite(meta["penumbra"]),
                given.get("camera_to_stage"),
                given["strong"],
                given.get("hidden"),
                given.get("dark"),
                None if meta.get("surround") is None else _surround(meta["surround"]),
                finite(meta.get("exposure", 1.0)),
                None if meta.get("between") is None else _between(meta["between"]),
            )
            within = None
            if meta["within"] is not None:
                value, growth = map(finite, meta["within"]["damping"])
                within = Within(
                    int(meta["within"]["step"]), states["within"], (value, growth), given["resting"]
                )
            return cls(
                str(meta["fingerprint"]),
                _NAMES[meta["phase"]],
                finite(meta["seconds"]),
                states.get("start"),
                states["began"],
                memory,
                ledger_from_json(meta["ledger"]),
                [dict(row) for row in meta["trace"]],
                within,
            )
        except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
            raise damaged(folder, error) from error

    def save(self, folder: Path) -> None:
        """Write the checkpoint into ``folder``, replacing the previous one."""
        write_arrays(folder / CHECKPOINT, self.arrays(), compress=False)

    @classmethod
    def load(cls, folder: Path) -> Checkpoint | None:
        """The checkpoint in ``folder``, or None when there is none."""
        if not (folder / CHECKPOINT).is_file():
            return None
        return cls.from_arrays(read_arrays(folder / CHECKPOINT, "checkpoint"), folder)

    def check(self, fingerprint: str, schedule: Schedule, folder: Path) -> None:
        """Raise InputError when the checkpoint belongs to another job than the one of this
        ``fingerprint``, or names a phase that the job's ``schedule`` has not.
        """
        if self.fingerprint != fingerprint:
            raise InputError(
                f"The checkpoint in '{folder}' belongs to another job (photo, landmarks or options "
                "differ); start again without --resume, or restore the options."
            )
        try:
            schedule[self.phase]
        except KeyError as error:
            raise damaged(folder, error) from error


def ledger_to_json(ledger: Ledger) -> dict[str, Any]:
    """The ledger as plain JSON."""
    return {
        "work": {kind: [work.seconds, work.units] for kind, work in ledger.work.items()},
        "skipped": [[rule, kind, units] for (rule, kind), units in ledger.skipped.items()],
    }


def ledger_from_json(data: Mapping[str, Any]) -> Ledger:
    """The reverse of :func:`ledger_to_json`.

    Raises KeyError, TypeError or ValueError for anything else.
    """
    work = {
        str(kind): Work(finite(seconds), finite(units))
        for kind, (seconds, units) in data["work"].items()
    }
    return Ledger(
        work, {(str(rule), str(kind)): finite(units) for rule, kind, units in data["skipped"]}
    )


def _surround(data: Mapping[str, Any]) -> Surround:
    """Raises KeyError, TypeError or ValueError for what is none."""
    gain, share = finite(data["gain"]), finite(data["share"])
    return Surround(tuple(map(int, data["lights"])), gain, share, bool(data["joined"]))


def _between(data: Mapping[str, Any]) -> SkinToSkin:
    """Raises KeyError, TypeError or ValueError for what is none."""
    deviation = np.inf if data["deviation"] is None else finite(data["deviation"])
    if deviation <= 0:
        raise ValueError("a standard deviation that is not positive")
    return SkinToSkin(finite(data["strength"]), deviation)


def damaged(folder: Path, error: Exception) -> InputError:
    """What is said of a checkpoint that cannot be understood."""
    return InputError(f"The checkpoint in '{folder}' is damaged ({error}); {AGAIN}.")


def other_version(folder: Path) -> InputError:
    """What is said of a checkpoint that another version of the program wrote."""
    return InputError(
        f"The checkpoint in '{folder}' was written by another version of Facestage; start "
        "again without --resume."
    )
