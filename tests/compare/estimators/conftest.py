"""Short recordings, and user files in a temporary current folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

EXAMPLES = Path(__file__).parents[3] / "examples"
Own = Callable[..., Estimate]


def short(name: str = "q1-short-dense", *overrides: str) -> Recording:
    """Return a recording of a few seconds of a scenario."""
    scenario = load_scenario(name, ["start=sampled", "trajectory.duration=4", *overrides])
    return simulate(scenario, 3)[1]


def agree(one: Estimate, other: Estimate, atol: float) -> None:
    """Compare poses, covariances and maps."""
    assert np.array_equal(one.landmark_ids, other.landmark_ids)
    for name in ("poses", "pose_covs", "landmarks", "landmark_covs"):
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=atol), name


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Own:
    """Return a function that runs `attribute` of a file with that source, as the commands do."""
    monkeypatch.chdir(tmp_path)

    def run(source: str, recording: Recording, attribute: str = "ekf_slam") -> Estimate:
        Path("mine.py").write_text(dedent(source))
        estimators = load_estimators([f"mine=mine.py:{attribute}"])
        return run_estimator("mine", estimators["mine"], recording)[0]

    return run
