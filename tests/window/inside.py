"""Runs inside Blender: does what the tests ask, one file of Python at a time, and answers.

A request is N.py in the folder $FACESTAGE_TALK; the answer is N.json. The code runs in the
largest 3D View's context; what it leaves in ``answer`` is sent back. ``beat``: how long the window
has answered nothing meanwhile.
"""

import json
import os
import sys
import time
import traceback
from pathlib import Path

import bpy

TALK = Path(os.environ["FACESTAGE_TALK"])
SECONDS = 0.05
# Processor seconds of this thread: when it was free last, what requests took since, and the longest
# that it was not free.
beat = {"last": time.thread_time(), "asked": 0.0, "longest": 0.0}


def tick() -> float:
    """Note how long the thread was not free, but for what the tests asked."""
    now = time.thread_time()
    beat["longest"] = max(beat["longest"], now - beat["last"] - beat["asked"])
    beat["last"], beat["asked"] = now, 0.0
    return 0.0


def view() -> dict[str, object]:
    """The context of the largest 3D View of the first window; of the window alone without one."""
    window = bpy.context.window_manager.windows[0]
    views = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    if not views:
        return {"window": window}
    area = max(views, key=lambda each: each.width * each.height)
    region = next(each for each in area.regions if each.type == "WINDOW")
    return {"window": window, "area": area, "region": region}


def listen() -> float:
    """Do what has been asked since the last call."""
    for request in sorted(TALK.glob("*.py")):
        start = time.thread_time()
        code = request.read_text(encoding="utf-8")
        request.unlink()
        known = {"bpy": bpy, "answer": None, "beat": beat}
        try:
            with bpy.context.temp_override(**view()):
                exec(compile(code, request.name, "exec"), known)
            answer = {"answer": known["answer"]}
        except Exception:  # noqa: BLE001  # whatever the test did wrong, the test is told
            answer = {"error": traceback.format_exc()}
        partial = request.with_suffix(".partial")
        partial.write_text(json.dumps(answer, default=str), encoding="utf-8")
        partial.rename(request.with_suffix(".json"))
        beat["asked"] += time.thread_time() - start
    return SECONDS


bpy.app.timers.register(listen, persistent=True)
bpy.app.timers.register(tick, persistent=True)
sys.stdout.flush()
