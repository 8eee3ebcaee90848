"""A short run over every reader, the findings of former runs, and the table of readers itself."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from fuzz.campaign import Campaign, described
from fuzz.pool import Hand
from fuzz.targets import TARGETS, counts
from fuzz.worker import FINDING

REGRESSIONS = Path(__file__).with_name("regressions")
INPUTS, SEED, JOBS = 800, 1, 1
# Calls that read what may come from a user.
READING = {
    "read_text",
    "read_bytes",
    "open",
    "open_regular",
    "loadtxt",
    "loadmat",
    "imdecode",
    "imread",
    "ZipFile",
    "frombuffer",
    "read_json",
    "read_arrays",
    "read_pickle",
    "json.loads",
    "json.load",
    "np.load",
    "h5py.File",
    "tarfile.open",
}
# Modules that read only what Facestage or the system itself wrote.
OWN_FILES = {
    "facestage.contract.quality": "its own quality.json",
    "facestage.models.anatomy.shipped_landmarks": "data of the project",
    "facestage.models.head.face_form": "data of the project",
    "facestage.report.page": "pictures that it has drawn",
    "facestage.report.person_page": "pictures that it has drawn",
    "facestage.batch.run": "its own journal, to add to it",
    "facestage.batch.summary": "a table that it writes",
    "facestage.report.batch_page": "pictures that it has drawn",
    "facestage.bench.relighting": "a table that it writes",
    "facestage.bench.following": "a table that it writes",
    "facestage.bench.mediapipe_weights": "a member of the bundle whose SHA-256 is checked",
    "facestage.bench.report": "pictures that it has drawn",
    "facestage.stress.outcome": "the trace that its own child has written",
    "facestage.stress.run": "the log of its own child",
    "facestage.fit.sequence.checkpoint": "its own checkpoint; damaged, it is refused as a whole",
    "facestage.fit.sequence.crew": "the null device",
    "facestage.fit.sequence.output": "its own folder",
    "facestage.fit.sequence.sightings": "its own checkpoint; damaged, it is refused as a whole",
    "facestage.fit.pieces.shared": "its own checkpoint; damaged, it is refused as a whole",
    "facestage.report.sequence_page": "pictures that it has drawn",
    "facestage.fit.result.memory": "the system's own account of memory",
    "facestage.contract.files.durable": "folders, to have them written",
    "facestage.contract.files.temporaries": "locks of its own",
    "facestage.images.quiet": "the null device",
    "facestage.landmarks.face_detector": "a member of the bundle whose SHA-256 is checked",
    "facestage.landmarks.face_mesh": "a member of the bundle whose SHA-256 is checked",
}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the workers keep the seeds that one of them has made."""
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def hand(home: Path) -> Iterator[Hand]:
    made = Hand(home)
    yield made
    made.stop()


def kept() -> list[Path]:
    return sorted(folder for folder in REGRESSIONS.glob("*/*") if folder.is_dir())


@pytest.mark.parametrize("folder", kept(), ids=lambda folder: f"{folder.parent.name}-{folder.name}")
def test_what_was_found_once_is_read_or_refused(hand: Hand, folder: Path) -> None:
    outcome = hand.read_folder(folder.parent.name, folder)
    assert outcome.verdict != FINDING, described(outcome)


@pytest.mark.slow
def test_a_short_run_over_every_reader_finds_nothing(home: Path) -> None:
    campaign = Campaign()
    plan = {name: range(count) for name, count in counts(INPUTS).items()}
    campaign.run(plan, SEED, JOBS, home, print)
    assert set(campaign.tallies) == set(TARGETS)
    assert not campaign.findings, "\n".join(
        described(outcome) for outcome in campaign.findings.values()
    )
    # Damage that everything refuses, or nothing, tests nothing.
    for name in ("job", "result", "person", "camera", "photo", "pickle", "arrays", "face-model"):
        tally = campaign.tallies[name]
        assert tally.accepted and tally.refused, f"{name}: {tally}"


def test_every_module_that_reads_is_in_the_table(repository: Path) -> None:
    covered = {module for target in TARGETS.values() for module in target.covers}
    reading = {}
    backend = repository / "backend"
    for path in sorted((backend / "facestage").rglob("*.py")):
        calls = reading_calls(ast.parse(path.read_text(encoding="utf-8")))
        if calls:
            parts = path.relative_to(backend).with_suffix("").parts
            reading[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = sorted(calls)
    unknown = {
        name: calls
        for name, calls in reading.items()
        if name not in covered and name not in OWN_FILES
    }
    assert not unknown, (
        "give each a target in tests/fuzz/targets.py, or say in OWN_FILES why it needs none"
    )
    assert not set(OWN_FILES) - set(reading), "a module of OWN_FILES reads no file"


def reading_calls(tree: ast.AST) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            last = name.rpartition(".")[2]
            found |= {name if name in READING else last} & READING
    return found
