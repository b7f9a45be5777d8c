"""The example filters in `examples/` estimate as well as the built-in ones; each is an online class in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamgauge import evaluate, load_estimators, load_scenario, simulate
from slamgauge.recording import Observations

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = {"robocentric": "robocentric_ekf.py:RobocentricEkf", "sigma-point": "sigma_point_ekf.py:SigmaPointEkf"}


@pytest.mark.slow
def test_their_error_is_that_of_the_built_in_filters() -> None:
    """On two fixed runs; a robocentric filter does not gain wrong information, like the right-invariant one."""
    names = ["ekf", "riekf", *(f"{name}={EXAMPLES / file}" for name, file in FILES.items())]
    runs = [simulate(load_scenario("q1-short-dense", ["start=sampled"]), seed) for seed in range(2)]
    estimators = load_estimators(names)
    ate = {
        name: np.mean([evaluate(truth, recording, estimator(recording))["ate_m"] for truth, recording in runs])
        for name, estimator in estimators.items()
    }
    assert 0.9 < ate["robocentric"] / ate["ekf"] < 1.3
    assert 0.95 < ate["robocentric"] / ate["riekf"] < 1.05
    assert 0.9 < ate["sigma-point"] / ate["ekf"] < 1.2


@pytest.mark.parametrize("name", FILES)
def test_they_refuse_observations_without_ids(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    module, kind = FILES[name].split(".py:")
    slam = getattr(__import__(module), kind)(np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="needs landmark ids"):
        slam.update(Observations(None, np.ones((1, 2)), np.eye(2)[None]))
