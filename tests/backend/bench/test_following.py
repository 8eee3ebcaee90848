"""The bench of films: the fit beside landmarks alone and MediaPipe's own weights."""

from __future__ import annotations

import csv
import io
import json
import sys
import types
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.bench import mediapipe_weights as peer
from facestage.bench.following import SEQUENCES_CSV, run_sequence_bench, weight_correlations
from facestage.cli.parser import build_parser
from facestage.contract.errors import InputError
from facestage.fit.sequence import run as run_module
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.render.variant import start_renderer
from reference.small_film import small_film
from reference.small_fit import QUICK


class Network:
    """Says the first coordinate that it is given, as every weight."""

    def __init__(self, model_content: bytes) -> None:
        assert model_content == b"network"

    def allocate_tensors(self) -> None:
        """As LiteRT wants it."""

    def get_input_details(self) -> list[dict[str, int]]:
        return [{"index": 0}]

    get_output_details = get_input_details

    def set_tensor(self, _index: int, points: np.ndarray) -> None:
        assert points.shape == (1, 146, 2) and points.dtype == np.float32
        self.first = points[0, 0, 0]

    def invoke(self) -> None:
        """As LiteRT wants it."""

    def get_tensor(self, _index: int) -> np.ndarray:
        return np.full(52, self.first)


def test_the_peers_network_is_asked_frame_by_frame(tmp_path: Path, monkeypatch: Any):
    with zipfile.ZipFile(tmp_path / "bundle", "w") as bundle:
        bundle.writestr(peer.NETWORK, b"network")
    opened = types.SimpleNamespace(path=tmp_path / "bundle")
    monkeypatch.setattr(peer, "open_model", lambda _chosen: opened)
    interpreter = types.SimpleNamespace(Interpreter=Network)
    monkeypatch.setitem(sys.modules, "ai_edge_litert", types.ModuleType("ai_edge_litert"))
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", interpreter)
    points = np.zeros((3, 478, 2))
    points[:, 0, 0] = 1, 2, 3
    points[1, 4] = np.nan
    said = peer.mediapipe_weights(list(points), "mediapipe478")
    assert said[0, 5] == 1 and np.isnan(said[1]).all() and said[2, 51] == 3


def test_without_its_runtime_the_peer_says_what_it_needs(monkeypatch: Any):
    monkeypatch.setitem(sys.modules, "ai_edge_litert.interpreter", None)
    with pytest.raises(peer.PeerMissingError, match="pip install ai-edge-litert"):
        peer.mediapipe_weights([], "mediapipe478")


def test_its_weights_are_compared_where_there_is_a_face():
    truth = SequenceTruth.__new__(SequenceTruth)
    truth.names = ("jawOpen", "eyeBlink_L", "other")
    truth.expression = np.array([[0.0, 0, 1], [0.5, 0, 2], [0.9, 0, 0], [1.0, 0, 0]])
    said = np.zeros((4, 52))
    said[:, peer.WEIGHTS["jawOpen"]] = 0.1, 0.35, np.nan, 0.6
    found = {"correlation_jawOpen": pytest.approx(1.0), "slope_jawOpen": pytest.approx(0.5)}
    assert weight_correlations(said, truth) == found


@pytest.mark.slow
def test_a_film_is_followed_by_all_that_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    start_renderer("cpu")
    film = small_film(tmp_path)
    monkeypatch.setattr(run_module, "look_through", film.looker())
    film.write_truth(film.folder / "truth.npz")
    camera = film.scene.state.camera.to_json()
    (film.folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    said, out = io.StringIO(), tmp_path / "out"
    code = run_sequence_bench([film.folder], f"npz:{film.model}", out, True, said, fineness=QUICK)
    assert code == 0
    assert "MediaPipe's weights skipped: the landmarks are ibug68's." in said.getvalue()
    with (out / SEQUENCES_CSV).open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    found = {(row["contender"], row["measure"]): float(row["value"]) for row in rows}
    alone, fitted = "landmarks alone", "with pictures"
    assert 0 < found[alone, "similarity_mm"] != found[fitted, "similarity_mm"] < 4
    assert 0 < found[alone, "seconds_a_frame"] < found[fitted, "seconds_a_frame"]


def test_a_folder_without_truth_is_refused_before_anything_is_written(tmp_path: Path):
    with pytest.raises(InputError, match="folders of pictures"):
        run_sequence_bench([tmp_path], None, tmp_path / "out", True, io.StringIO())
    assert not (tmp_path / "out").exists()


def test_options_of_photos_are_refused():
    options = build_parser().parse_args(["bench", "--sequence", "film", "--plan"])
    with pytest.raises(InputError, match="leave out --case, --plan"):
        options.run(options)
