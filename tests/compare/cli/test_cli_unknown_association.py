"""The commands on recordings without ids: written files, the associations that the optima receive, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth
from tests.kernels import compile_kernels
from tests.reference.command_line import run

pytestmark = pytest.mark.slow
DURATION = "trajectory.duration=6"


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    compile_kernels()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    estimators = "ekf,riekf,causal,batch,causal@ekf,robust-batch@ekf"
    assert run("run", "q2-long-dense", "--estimators", estimators, "--set", DURATION, "--out", out) == 0
    return out


def entries(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "metrics.json").read_text())["estimators"]


def test_the_stored_recording_has_no_ids_and_the_truth_has_them(folder: Path):
    recording, truth = load_recording(folder / "recording.npz"), load_truth(folder / "truth.npz")
    assert recording.landmark is None
    assert truth.association is not None
    assert len(truth.association) == len(recording.observation)


def test_the_metrics_of_association(folder: Path):
    found = entries(folder)
    for name in ("causal", "batch"):
        assert found[name]["wrong_associations"] == 0
        assert found[name]["landmarks_missed"] == 0
    ekf = found["ekf"]
    assert ekf["landmarks_mapped"] > ekf["landmarks_true"] - ekf["landmarks_missed"]
    given = np.asarray(load_estimate(folder / "estimates/ekf.npz").association)
    assert np.array_equal(np.asarray(load_estimate(folder / "estimates/causal@ekf.npz").association), given)


def test_evaluating_the_stored_recording_gives_the_same_metrics(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert run("evaluate", folder / "recording.npz", "--estimators", "ekf,causal", "--json") == 0
    again = json.loads(capsys.readouterr().out)["estimators"]
    for name, entry in again.items():
        known = entries(folder)[name]
        keys = set(entry) - {"seconds_total", "final_distance_to_batch_m"}
        assert {key: entry[key] for key in keys} == {key: known[key] for key in keys}


def test_evaluate_associates_as_its_options_state(folder: Path, capsys: pytest.CaptureFixture[str]):
    mapped: list[int] = []
    for option in ("gate=1", "gate=9", "method=jcbb"):
        options = ("--estimators", "riekf", "--json", "--set", f"association.{option}")
        assert run("evaluate", folder / "recording.npz", *options) == 0
        mapped.append(json.loads(capsys.readouterr().out)["estimators"]["riekf"]["landmarks_mapped"])
    assert mapped[0] > mapped[1] > mapped[2]


def test_refused_gates_and_optima(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for options, refusal in {
        "association.gate=0": "association.gate: 0.0 is out of range; choose it above 0",
        "association.gate=1e308": "association.gate: must be at most 1e+50 in size, not 1e+308",
        "association.method=known": "association.method: must be 'nearest-neighbour' or 'jcbb', not 'known'",
        "association.gat=9": "association.gat: unknown key; did you mean gate?",
        "motion.slip=1": "motion: not a setting of stored recordings; give association.method=jcbb",
    }.items():
        assert run("evaluate", folder / "recording.npz", "--set", options) == 2
        assert capsys.readouterr().err == f"slamgauge: set: {refusal}\n"
    alone = tmp_path / "recording.npz"
    alone.write_bytes((folder / "recording.npz").read_bytes())
    assert run("evaluate", alone, "--estimators", "dead-reckoning,batch") == 1  # neither makes associations
    reason = capsys.readouterr().out.splitlines()[-1]
    assert reason.startswith("estimator batch: landmark: the graph needs known association")
    assert reason.endswith("batch@ekf")
