"""One case in a process of its own: `python -m facestage.stress.child NAME FOLDER` writes
FOLDER/outcome.json.
"""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.stress.case import Case
from facestage.stress.outcome import CRASHED, REFUSED, Outcome, read_outcome

OUTCOME = "outcome.json"


def run_case(case: Case, folder: Path) -> Outcome:
    """Build the case's files in ``folder`` and fit them; a crash is an outcome too."""
    from facestage.fit.result.run import fit_job

    folder.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        try:
            job = case.build(folder)
            began = time.monotonic()
            result = fit_job(job, folder / "result")
            seconds = time.monotonic() - began
            return read_outcome(case.name, result, folder / "result", seconds, _numerical(caught))
        except InputError as error:
            return Outcome(case.name, REFUSED, str(error), time.monotonic() - began)
        except Exception as error:  # noqa: BLE001 - a crash of any kind is what the table is there to show
            traceback.print_exc()
            sentence = f"{type(error).__name__}: {error} ({_where(error)})"
            return Outcome(
                case.name, CRASHED, sentence, time.monotonic() - began, warnings=_numerical(caught)
            )


def _where(error: BaseException) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{Path(frame.filename).name}:{frame.lineno}"


def _numerical(caught: list[warnings.WarningMessage]) -> tuple[str, ...]:
    """Each numerical warning once, with its place."""
    found = [
        f"{item.message} ({Path(item.filename).name}:{item.lineno})"
        for item in caught
        if issubclass(item.category, RuntimeWarning)
    ]
    return tuple(dict.fromkeys(found))


def main(arguments: list[str]) -> int:
    """Run the named case; the outcome file is the answer, so the exit code only says that it was
    written.
    """
    from facestage.stress.cases import CASES

    name, folder = arguments[0], Path(arguments[1])
    run_case(CASES[name], folder).save(folder / OUTCOME)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
