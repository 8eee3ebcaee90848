"""A backend without a fit: answers the command line with a made-up result, or misbehaves as told.

STAND_IN_MOOD: works, sees no face (detect exits 2), refuses (exit 2 with a sentence), hangs (until
it is stopped), stubborn (ignores being stopped), crashes (exit 1 with a traceback), chatty (a
megabyte of noise on both streams).
STAND_IN_STATUS: the result's status, converged if not set.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from types import ModuleType


def main() -> int:
    mood, verb = os.environ["STAND_IN_MOOD"], sys.argv[1]
    options = dict(zip(sys.argv[2:], sys.argv[3:], strict=False))
    if mood == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    say("started", 0.0)
    if mood == "refuses":
        print("facestage: The photo is of a cat; expected a face.", file=sys.stderr)
        return 2
    if mood == "crashes":
        raise RuntimeError("out of luck")
    if mood in ("hangs", "stubborn"):
        time.sleep(600)
    if mood == "chatty":
        print(("noise " * 20 + "\n") * 8000, flush=True)
        print(("complaint " * 20 + "\n") * 8000, file=sys.stderr, flush=True)
    if verb == "model":
        shutil.copyfile(os.environ["STAND_IN_MODEL"], options["--out"])
    elif verb == "fit":
        if mood == "hangs in fit":
            Path(options["--out"] + ".partial").mkdir(parents=True, exist_ok=True)
            time.sleep(600)
        out = Path(options["--out"])
        if "--same-person" in sys.argv:
            first, last = sys.argv.index("--job") + 1, sys.argv.index("--same-person")
            results().fit_person([Path(job) for job in sys.argv[first:last]], out)
        else:
            results().fit(Path(options["--job"]), out)
    elif verb == "detect":
        if mood == "sees no face":
            print(
                "facestage: No face was found in the photo; choose another photo.", file=sys.stderr
            )
            return 2
        results().detect(Path(sys.argv[2]), Path(options["--out"]), int(options["--face"]))
    elif verb == "render":
        results().relight_cache(Path(sys.argv[2]))
    elif verb == "track":
        results().track_again(
            Path(sys.argv[2]), Path(options["--out"]), Path(options["--corrected"]), options
        )
    elif verb == "doctor":
        print("everything works", flush=True)
    say("done", 1.0)
    return 0


def results() -> ModuleType:
    """The module that makes things up; importing it takes longer than all else here."""
    sys.path.insert(0, str(Path(__file__).parent.parent))
    from addon import stand_in_results

    return stand_in_results


def say(kind: str, fraction: float) -> None:
    event = {"kind": kind, "stage": "pretending", "fraction": fraction, "error": 0.25}
    print(json.dumps(event), flush=True)


if __name__ == "__main__":
    sys.exit(main())
