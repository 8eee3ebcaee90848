"""``make fuzz``: read damaged inputs for minutes, print what was found, and keep the smallest input
of each finding.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import sys
from pathlib import Path

from fuzz.campaign import Campaign, described
from fuzz.case import keep, size_of
from fuzz.pool import Hand, Outcome, stored_seeds, work_folder
from fuzz.shrink import TRIES, shrunk
from fuzz.targets import TARGETS, counts

REGRESSIONS = Path(__file__).with_name("regressions")
KEPT_BYTES = 64 << 10
HANG_TRIES = 8


def main() -> int:
    options = _options()
    home = work_folder()
    try:
        if options.repeat:
            return _repeat(options.repeat, home)
        return _run(options, home)
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make fuzz", description=__doc__)
    parser.add_argument(
        "--inputs", type=int, default=100_000, help="how many, over all targets by their shares"
    )
    parser.add_argument("--seconds", type=float, help="stop after so long")
    parser.add_argument("--seed", type=int, default=0, help="another seed gives other inputs")
    parser.add_argument("--target", nargs="+", choices=sorted(TARGETS), help="only these")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes that read")
    parser.add_argument(
        "--repeat",
        metavar="TARGET/SEED/NUMBER",
        help="read one input again and show what comes of it",
    )
    parser.add_argument(
        "--no-keep", action="store_true", help="do not write findings to tests/fuzz/regressions"
    )
    return parser.parse_args()


def _run(options: argparse.Namespace, home: Path) -> int:
    shares = counts(options.inputs)
    if options.target:
        chosen = sum(shares[name] for name in options.target)
        shares = {name: max(1, options.inputs * shares[name] // chosen) for name in options.target}
    plan = {name: range(count) for name, count in shares.items()}
    campaign = Campaign()
    campaign.run(plan, options.seed, options.jobs, home, _tell, options.seconds)
    if campaign.findings and not options.no_keep:
        _keep_all(campaign, home)
    print(campaign.table())
    for key, outcome in sorted(campaign.findings.items()):
        print(f"{campaign.repeats[key]:6d} x {described(outcome)}")
    return 1 if campaign.findings else 0


def _tell(line: str) -> None:
    print(line, flush=True)


def _keep_all(campaign: Campaign, home: Path) -> None:
    """The smallest input of each finding, among the regressions, which the tests read again for
    ever.
    """
    hand = Hand(home)
    try:
        for outcome in campaign.findings.values():
            folder = _keep(hand, outcome, home)
            _tell(
                f"kept {folder}"
                if folder
                else f"too large to keep: {outcome.target}/{outcome.seed}/{outcome.number}"
            )
    finally:
        hand.stop()


def _keep(hand: Hand, outcome: Outcome, home: Path) -> Path | None:
    target = TARGETS[outcome.target]
    case = target.case(stored_seeds(home, outcome.target), outcome.seed, outcome.number)
    assert case is not None
    slow = outcome.kind == "hang" or outcome.ms > 1000
    case = shrunk(
        hand, outcome.target, case, outcome, home / "candidate", HANG_TRIES if slow else TRIES
    )
    if size_of(case) > KEPT_BYTES:
        return None
    digest = hashlib.sha256(repr(outcome.signature).encode()).hexdigest()[:8]
    folder = REGRESSIONS / outcome.target / f"{outcome.kind.lower().replace(' ', '-')}-{digest}"
    keep(case, folder)
    return folder


def _repeat(name: str, home: Path) -> int:
    target, seed, number = name.split("/")
    hand = Hand(home)
    try:
        (outcome,) = hand.run(target, int(seed), [int(number)])
        made = TARGETS[target].case(stored_seeds(home, target), int(seed), int(number))
    finally:
        hand.stop()
    for file, content in (made or {}).items():
        print(f"{file}: {len(content)} bytes: {content[:300]!r}")
    print(outcome.text)
    print(described(outcome) if outcome.verdict == "finding" else outcome)
    return 1 if outcome.verdict == "finding" else 0


if __name__ == "__main__":
    sys.exit(main())
