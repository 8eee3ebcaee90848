"""Checkpoints and command lines."""

from __future__ import annotations

import json

import numpy as np

from facestage.fit.energy.plan import Ledger, Work
from facestage.fit.face.state import State
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.joint_checkpoint import JointCheckpoint
from facestage.fit.stages.passage import Within
from facestage.fit.stages.skin_to_skin import SkinToSkin
from facestage.fit.stages.surround import Surround
from facestage.fit.stages.view import Memory
from fuzz.case import Case
from fuzz.seeds.contract import (
    LIGHTS,
    camera,
    face_models,
    job_folders,
    numbers,
    render_folders,
    rig_files,
    rigid,
    written,
)
from fuzz.seeds.images import encoded, picture

GIVEN, FROZEN = "--landmarks landmarks.json", "--focal-px 60 --freeze pose roughness"
COMMANDS = (
    f"fit photo.png --out new {GIVEN} --camera camera.json --model npz:face.npz --lights 4",
    f"fit photo.png --out new {FROZEN} --seed 3 --device cpu --plan full --budget draft",
    f"fit photo.png photo.png --same-person --out new {GIVEN} {GIVEN} --resume",
    "fit --job job --out new --truth truth.npz --plan lean",
    "fit --job job job --same-person --out new",
    "detect missing.png --out new.json --face 2",
    "detect photo.png --out new.json --picture new.jpg --all",
    "render result --out new.png --lights lights.json --weights weights.json --spp 4",
    "render result --cache",
    "render result --out new.exr --environment photo.exr@40 --strength 2",
    "reflectance result --out new --directions 24 --spp 2",
    "batch photo.png --out new --workers 2 --freeze pose",
    "model npz:face.npz --out new.npz",
    "model default",
    "bench --case job --model default --out new --quick --seed 3",
    "bench --plan --out new --device cpu",
    "stress --list",
    "stress --case grazing-light --out new",
    "doctor",
    "--version",
)


def _state() -> State:
    return State(
        rigid(1)[:3, :3],
        np.array([0, 0, -0.6]),
        camera(),
        numbers(1, 3),
        numbers(2, 2),
        numbers(3, 3 * LIGHTS),
        numbers(4, LIGHTS, 2),
        numbers(5, 4),
        0.4,
        np.full((2, 2), 0.5),
    )


def checkpoint(step: int | None = 3) -> Checkpoint:
    """In the middle of a phase, or (None) before its first step."""
    strong, surround = np.array([True, False, True]), Surround((0,), 50.0, 0.1, joined=False)
    hidden, dark = np.zeros((4, 5), bool), np.ones((4, 5), bool)
    between = SkinToSkin(0.2, 0.4)
    memory = Memory(1.5, 0.1, rigid(3), strong, hidden, dark, surround, 1.0, between)
    ledger = Ledger({"rays": Work(1.5, 20.0)}, {("resting lights", "rays"): 5.0})
    within = (
        None
        if step is None
        else Within(step, _state(), (1e-3, 2.0), np.array([False, False, True]))
    )
    trace = [{"stage": "pose", "iteration": 1, "energy": 2.5}]
    return Checkpoint(
        "fingerprint", "light and albedo", 12.5, _state(), _state(), memory, ledger, trace, within
    )


def checkpoints() -> list[Case]:
    return [written(checkpoint().save), written(checkpoint(None).save)]


def joint_checkpoints() -> list[Case]:
    joint = JointCheckpoint(
        (checkpoint(), checkpoint(None)), ("", "a"), (0.5, 2.0), (True, False), False
    )
    return [written(joint.save)]


def command_lines() -> list[Case]:
    """Every command, in a folder with a file of every kind that it may name."""
    from PIL import Image

    folder: Case = {
        "photo.png": encoded(Image.fromarray(picture()), "PNG"),
        **face_models()[0],
        **rig_files()[0],
    }
    folder |= {f"job/{name}": data for name, data in job_folders()[0].items()}
    render = render_folders()[0]
    beside = ("lights.json", "weights.json")
    folder |= {name if name in beside else f"result/{name}": data for name, data in render.items()}
    folder["camera.json"] = json.dumps(camera().to_json()).encode()
    points = [[8.0 + k % 8, 5.0 + k // 8] for k in range(68)]
    folder["landmarks.json"] = json.dumps({"scheme": "ibug68", "points": points}).encode()
    return [{"arguments.argv": json.dumps(line.split()).encode()} | folder for line in COMMANDS]
