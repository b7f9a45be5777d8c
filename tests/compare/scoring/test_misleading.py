"""Outliers and clutter: scores, optima that leave them out, and optima that contradict the stated noise."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.scoring.comparison import compare_estimators, table
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_notes import is_misfit, is_misfit_in_runs
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.summary import misfit_optima, summary_table
from slamgauge.graph_baseline import batch
from tests.reference import example_records as examples
from tests.reference.given import given

pytestmark = pytest.mark.slow

SHORT = ("start=sampled", "trajectory.duration=20")
BAD = ("sensor.outlier_rate=0.05", "sensor.clutter_rate=0.3")


@pytest.mark.parametrize("method", ["known", "jcbb"])
def test_the_optima_leave_outliers_and_clutter_out(method: str) -> None:
    """They are the optima of the recording without them; other estimators receive all observations."""
    scenario = load_scenario("q1-short-dense", [*SHORT, *BAD, f"association.method={method}"])
    truth, recording, told = simulate_informed(scenario, 2)
    estimators = load_estimators(["ekf", "causal", "batch"], Association(method=scenario.association.method))
    comparison = compare_estimators(truth, recording, estimators, told)
    stored = compare_estimators(truth, recording, load_estimators(["batch"]))  # ids of the truth
    misleading = given(truth.misleading)
    alone = batch(told.only(~misleading))
    found = comparison.estimates["batch"]
    np.testing.assert_allclose(found.poses, alone.poses, atol=1e-9)
    np.testing.assert_allclose(stored.estimates["batch"].poses, found.poses, atol=1e-12)
    np.testing.assert_array_equal(given(found.association)[~misleading], alone.association)
    np.testing.assert_array_equal(given(found.association)[misleading], -1)
    assert not is_misfit(found)
    text = str(table(comparison))
    assert "leaves out" not in text
    assert "?" not in text
    taken_in = (given(comparison.estimates["ekf"].association)[misleading] >= 0).mean()
    assert taken_in == 1.0 if method == "known" else taken_in < 0.3


def test_residuals_are_implausible_if_significantly_and_much_off() -> None:
    cases = {(1.0, 1000): False, (1.04, 10**6): False, (1.2, 100): False, (1.2, 10_000): True, (0.8, 10_000): True}
    for (per_dof, dof), expected in cases.items():
        optimum = replace(examples.estimate(kind="smoothed"), chi_square=per_dof * dof, chi_square_dof=dof)
        assert is_misfit(optimum) is expected
    fits = [Interval(2.0, None, None), Interval(1.2, 1.04, 1.36), Interval(1.2, 1.1, 1.3), Interval(0.5, 0.4, 0.6)]
    assert [is_misfit_in_runs(fit) for fit in (None, *fits)] == [False, False, False, True, True]


def test_a_study_names_and_marks_optima_whose_residuals_contradict_the_noise(tmp_path: Path) -> None:
    """The odometry has an error that no estimator knows of, so the optimum is wrong too; outliers are left out."""
    names = ("riekf", "causal", "batch")
    for more, misfits, marks in (("motion.scale_error=0.5",), ["batch", "causal"], 1), (BAD, [], 0):
        with ThreadPoolExecutor(1) as thread:
            found = run_study(load_scenario("q1-short-dense", [*SHORT, *more]), 3, 0, names, tmp_path / more[0], thread)
        assert misfit_optima(found) == misfits
        page = str(summary_table(found))
        assert [row.count("?") for row in page.splitlines()[1:4]] == [marks] * 3  # x causal
        assert ("the residuals of batch and causal contradict the stated noise" in page) == bool(misfits)
        assert ("optimum" not in str(found.estimators["riekf"]["verdict"])) == bool(misfits)
