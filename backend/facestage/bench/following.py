"""A film with known truth: the fit's performance beside landmarks alone and MediaPipe's weights."""

from __future__ import annotations

import csv
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from facestage.bench.mediapipe_weights import WEIGHTS, PeerMissingError, mediapipe_weights
from facestage.bench.run import make_folder
from facestage.contract.arrays import Float
from facestage.contract.camera import Camera
from facestage.contract.errors import EXIT_DONE, InputError
from facestage.contract.files.atomic import atomic_file
from facestage.contract.quality import DRAFT, GOOD
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.run import SequenceRun
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.images.film import Film

SEQUENCES_CSV = "sequences.csv"
TRUTH, CAMERA = "truth.npz", "camera.json"
SECONDS, CORRELATION, SLOPE = "seconds_a_frame", "correlation_", "slope_"


@dataclass(frozen=True)
class Followed:
    """One film by one contender: errors by name (millimetres, ratios, frames, correlations), and
    the processor time of a frame, without the keyframes'.
    """

    film: str
    contender: str
    measures: Mapping[str, float]


def run_sequence_bench(
    folders: Sequence[Path],
    model: str | None,
    out: Path,
    quick: bool,
    stream: TextIO,
    *,
    device: str = "auto",
    seed: int = 0,
    fineness: Fineness = USUAL,
) -> int:
    """Follow the films in ``folders`` (pictures, camera.json, truth.npz), print the table to
    ``stream`` and write it to ``out``. ``quick``: pictures are looked at once. Raises InputError.
    """
    for folder in folders:
        if not (folder / TRUTH).is_file():
            raise InputError(
                f"'{folder}' has no {TRUTH}; bench --sequence wants folders of pictures with one."
            )
    make_folder(out)
    rows: list[Followed] = []
    for folder in folders:
        request = Request(
            film=folder,
            model=model or "default",
            camera=Camera.read(folder / CAMERA) if (folder / CAMERA).is_file() else None,
            quality=DRAFT if quick else GOOD,
            truth=folder / TRUTH,
            seed=seed,
            device=device,
        )
        new, reason = follow(request, fineness)
        rows += new
        for line in [*_lines(new), *reason]:
            print(line, file=stream, flush=True)
    _write(out / SEQUENCES_CSV, rows)
    print(f"Written: {out / SEQUENCES_CSV}", file=stream)
    return EXIT_DONE


def follow(request: Request, fineness: Fineness = USUAL) -> tuple[list[Followed], list[str]]:
    """All contenders on the landmarks of one run, and why one is missing."""
    assert request.truth is not None
    with tempfile.TemporaryDirectory(prefix="facestage-bench-") as scratch:
        film = Film(request.film, request.rate)
        run = SequenceRun(request, film, Path(scratch), lambda _: None, None, fineness)
        found = run.run(resume=False)
    sightings, timings = found.sightings, found.timings
    count, name = len(sightings), request.film.name
    alone = timings["landmarks_cpu"] + timings["smoothing_cpu"]
    seconds = {SECONDS: alone / count}
    rows = [Followed(name, "landmarks alone", dict(found.errors_by_landmarks) | seconds)]
    reason = []
    try:
        began = time.process_time()
        said = mediapipe_weights(sightings.points, sightings.scheme)
        taken = timings["landmarks_cpu"] + time.process_time() - began
        truth = SequenceTruth(request.truth, found.model, count)
        measures = weight_correlations(said, truth) | {SECONDS: taken / count}
        rows.append(Followed(name, "MediaPipe's weights", measures))
    except PeerMissingError as error:
        reason = [str(error)]
    seconds = {SECONDS: (alone + timings["pictures_cpu"]) / count}
    rows.append(Followed(name, "with pictures", dict(found.errors) | seconds))
    return rows, reason


def weight_correlations(
    said: Float[np.ndarray, "frames 52"], truth: SequenceTruth
) -> dict[str, float]:
    """Of each of MediaPipe's weights that the ``truth`` has and that moves, over frames with a
    face; and slopes, by how much they move where the truth moves by one.
    """
    seen = np.isfinite(said).all(axis=1)
    result: dict[str, float] = {}
    if truth.expression is None or seen.sum() < 2:
        return result
    for name, number in WEIGHTS.items():
        if name in truth.names:
            true, found = truth.expression[seen, truth.names.index(name)], said[seen, number]
            if true.std() > 0 and found.std() > 0:
                result[f"{CORRELATION}{name}"] = float(np.corrcoef(found, true)[0, 1])
                result[f"{SLOPE}{name}"] = float(np.polyfit(true, found, 1)[0])
    return result


def _shown(rows: Sequence[Followed]) -> list[str]:
    """The measures that are printed, of those that any row has."""
    wanted = ["similarity_mm", "frame_similarity_mm", "jitter_ratio", "lag_frames"]
    wanted += [f"{kind}{name}" for kind in (CORRELATION, SLOPE) for name in WEIGHTS] + [SECONDS]
    return [name for name in wanted if any(name in row.measures for row in rows)]


def _lines(rows: Sequence[Followed]) -> list[str]:
    """A column for each contender."""
    contenders = [row.contender for row in rows]
    width = max(map(len, contenders)) + 2
    result = [f"{rows[0].film:28}" + "".join(name.rjust(width) for name in contenders)]
    for measure in _shown(rows):
        values = (row.measures.get(measure) for row in rows)
        texts = ("" if value is None else f"{value:.3f}" for value in values)
        result.append(f"{measure:28}" + "".join(text.rjust(width) for text in texts))
    return result


def _write(path: Path, rows: Sequence[Followed]) -> None:
    """A line for each film, contender and measure."""
    with (
        atomic_file(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream)
        writer.writerow(["film", "contender", "measure", "value"])
        for row in rows:
            for name, value in row.measures.items():
                writer.writerow([row.film, row.contender, name, f"{value:.6g}"])
