"""Without GTSAM: the exact optima are the same, and everything that does not need GTSAM runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import riekf
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.hindsight import optimum_from
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver import levenberg_marquardt, multistart
from slamgauge.recording import Recording
from tests.reference.random_recordings import recording_of

ROOT = Path(__file__).parents[2]
BLOCKED = ROOT / "tests/without_gtsam"
SELECTED = (
    *("tests/graph_baseline/test_given_associations.py", "tests/graph_baseline/test_bound.py"),
    *("tests/compare/studies/test_optima_in_studies.py", "tests/compare/scoring/test_scores.py"),
)  # CONTRIBUTING.md describes how to run all tests without GTSAM
SHORT = "not given_ids and not shrinks"


def both_ways(recording: Recording, path: np.ndarray | None, monkeypatch: pytest.MonkeyPatch) -> list[Estimate]:
    """Return the optimum with starts of GTSAM's optimiser and of ours, from a path or from the default of `batch`."""
    found: list[Estimate] = []
    for descend in (multistart.descend, levenberg_marquardt.descend):
        with monkeypatch.context() as context:
            context.setattr(multistart, "descend", descend)
            found.append(batch(recording) if path is None else optimum_from(prepare(recording), path))
    return found


@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
@pytest.mark.parametrize("of_filter", [False, True], ids=["dead-reckoning", "filter"])
def test_the_built_in_optimiser_leads_to_the_same_minimum(
    sensor: str, slip: bool, of_filter: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in range(2):
        recording = recording_of(sensor, seed, slip=slip)
        theirs, ours = both_ways(recording, riekf(recording).poses if of_filter else None, monkeypatch)
        for key in ("poses", "landmarks", "pose_covs", "landmark_covs"):
            np.testing.assert_allclose(getattr(ours, key), getattr(theirs, key), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["q1-short-dense", "q1-long-sparse", "q4-three-landmarks"])
def test_the_built_in_optimiser_leads_to_the_same_minimum_on_scenarios(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs, ours = both_ways(simulate(load_scenario(name, ["start=sampled"]), 3)[1], None, monkeypatch)
    np.testing.assert_allclose(ours.poses, theirs.poses, rtol=0, atol=1e-9)
    assert ours.chi_square == pytest.approx(theirs.chi_square, rel=1e-9)


def without_gtsam(*words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with `words`; it and its child processes cannot import gtsam."""
    path = os.pathsep.join([str(BLOCKED), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )


def test_tests_that_do_not_need_gtsam_pass() -> None:
    done = without_gtsam("-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-k", SHORT, *SELECTED)
    assert done.returncode == 0, done.stdout
    used = without_gtsam("-c", "import slamgauge.graph_baseline.solver.multistart as s; print(s.descend.__module__)")
    assert used.stdout == "slamgauge.graph_baseline.solver.levenberg_marquardt\n"


def test_the_four_estimators_of_gtsam_name_an_alternative_and_all_others_run(tmp_path: Path) -> None:
    words = (
        "run",
        "q1-short-dense",
        "--set",
        "trajectory.duration=3",
        "--estimators",
        "ekf,causal,batch,robust-batch,fixed-lag,isam2,gtsam-batch",
    )
    done = without_gtsam("-m", "slamgauge", *words, "--no-report", "--wide", "--out", str(tmp_path / "run"))
    for name, other in (
        ("robust-batch", "batch"),
        ("gtsam-batch", "batch"),
        ("fixed-lag", "causal"),
        ("isam2", "causal"),
    ):
        reason = f"estimator {name}: needs GTSAM, which cannot be imported (there is no gtsam); use {other}"
        assert reason in done.stdout
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    rows = {line.split()[0]: line.split()[1] for line in done.stdout.splitlines() if line}
    assert [rows[name] for name in ("ekf", "causal", "batch", "robust-batch")] == [
        *("filtered", "filtered", "smoothed", "failed")
    ]
