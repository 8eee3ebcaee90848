"""A run over many inputs: who reads what, what was found, and the smallest input of each
finding.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fuzz.pool import Hand, Outcome
from fuzz.worker import ACCEPTED, FINDING, REFUSED

BATCH = 100


@dataclass
class Tally:
    """What came of a target's inputs."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    found: int = 0
    slowest_ms: float = 0.0
    peak_mib: float = 0.0
    processor_s: float = 0.0

    def add(self, outcome: Outcome) -> None:
        self.inputs += 1
        self.accepted += outcome.verdict == ACCEPTED
        self.refused += outcome.verdict == REFUSED
        self.found += outcome.verdict == FINDING
        self.slowest_ms = max(self.slowest_ms, outcome.ms)
        self.peak_mib = max(self.peak_mib, outcome.mib)
        self.processor_s += outcome.ms / 1e3


@dataclass
class Campaign:
    """The tallies by target and, by its signature, the first finding of each cause."""

    tallies: dict[str, Tally] = field(default_factory=dict)
    findings: dict[tuple[str, str, str], Outcome] = field(default_factory=dict)
    repeats: dict[tuple[str, str, str], int] = field(default_factory=dict)

    def add(self, outcome: Outcome) -> bool:
        """Count it; true for a finding of a cause that was not seen before."""
        self.tallies.setdefault(outcome.target, Tally()).add(outcome)
        if outcome.verdict != FINDING:
            return False
        key = outcome.signature
        self.repeats[key] = self.repeats.get(key, 0) + 1
        # Whichever worker is faster, the lowest number is kept.
        known = self.findings.get(key)
        if known is None or outcome.number < known.number:
            self.findings[key] = outcome
        return known is None

    def run(
        self,
        plan: Mapping[str, Iterable[int]],
        seed: int,
        jobs: int,
        home: Path,
        tell: Callable[[str], None],
        seconds: float | None = None,
    ) -> None:
        """Read ``plan`` (numbers by target) in ``jobs`` processes; stop after ``seconds``."""
        orders: queue.SimpleQueue[tuple[str, list[int]]] = queue.SimpleQueue()
        total = 0
        for target, numbers in _interleaved(plan):
            orders.put((target, numbers))
            total += len(numbers)
        lock, start, state = threading.Lock(), time.monotonic(), {"done": 0, "told": 0.0}
        errors: list[BaseException] = []

        def work() -> None:
            hand = Hand(home)
            try:
                while seconds is None or time.monotonic() - start < seconds:
                    try:
                        target, numbers = orders.get_nowait()
                    except queue.Empty:
                        return
                    for outcome in hand.run(target, seed, numbers):
                        with lock:
                            state["done"] += 1
                            if self.add(outcome):
                                tell(described(outcome))
                            passed = time.monotonic() - start
                            if passed - state["told"] > 10:
                                state["told"] = passed
                                rate = state["done"] / passed
                                tell(
                                    f"{state['done']:.0f} of {total} inputs, {rate:.0f} a "
                                    f"second, {passed:.0f} s"
                                )
            # A thread's exception is the run's.
            except BaseException as error:  # noqa: BLE001
                errors.append(error)
            finally:
                hand.stop()

        threads = [threading.Thread(target=work, daemon=True) for _ in range(jobs)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        if errors:
            raise errors[0]

    def table(self) -> str:
        titles = ("inputs", "accepted", "refused", "findings", "slowest ms", "peak MiB", "mean ms")
        lines = [f"{'target':18}" + "".join(f"{title:>12}" for title in titles)]
        for name, tally in sorted(self.tallies.items()):
            causes = sum(key[0] == name for key in self.findings)
            mean = 1e3 * tally.processor_s / max(tally.inputs, 1)
            cells = (
                tally.inputs,
                tally.accepted,
                tally.refused,
                f"{causes}/{tally.found}",
                f"{tally.slowest_ms:.0f}",
                f"{tally.peak_mib:.0f}",
                f"{mean:.1f}",
            )
            lines.append(f"{name:18}" + "".join(f"{cell:>12}" for cell in cells))
        whole = sum(tally.inputs for tally in self.tallies.values())
        lines.append(f"{'all':18}{whole:12d}{f'{len(self.findings)} causes':>36}")
        return "\n".join(lines)


def described(outcome: Outcome) -> str:
    """One line: what, where, and how to see it again."""
    text = " | ".join(outcome.text.strip().splitlines()[-1:])[:160]
    return (
        f"FINDING {outcome.target}: {outcome.kind} at {outcome.where}: {text!r}; "
        f"make fuzz REPEAT={outcome.target}/{outcome.seed}/{outcome.number}"
    )


def _interleaved(plan: Mapping[str, Iterable[int]]) -> list[tuple[str, list[int]]]:
    """Batches, the targets in turn, so that a run that is cut short has read of each."""
    batches = []
    for target, numbers in plan.items():
        listed = list(numbers)
        parts = max(1, -(-len(listed) // BATCH))
        cut = [
            listed[k * len(listed) // parts : (k + 1) * len(listed) // parts] for k in range(parts)
        ]
        batches += [(k / parts, target, part) for k, part in enumerate(cut) if part]
    return [(target, part) for _, target, part in sorted(batches, key=lambda batch: batch[:2])]
