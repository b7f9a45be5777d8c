"""Quality of the optima, in metrics.json and in notes under the tables."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from slamgauge import compare_estimators, load_estimators, load_scenario, simulate
from slamgauge.compare.scoring.comparison import Comparison, metrics, notes, table
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval, ratio_interval
from slamgauge.compare.scoring.optimum_notes import MARK, beats_the_optimum, fit_of_the_model, mean_fit
from slamgauge.compare.scoring.runs import CHECK_LIMIT
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference import example_records as examples
from tests.reference.given import given

FILTER = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.2))
CAUSAL = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.1), nis=None, nis_dof=None)
BATCH = replace(CAUSAL, kind="smoothed")
BEARINGS = examples.recording(
    sensor="bearing", observation=np.zeros((3, 1)), observation_cov=np.tile(np.eye(1), (3, 1, 1))
)
FIT, MARKED = "fit of the model: chi2/dof of the", "figures relative to it are marked ?"


def compared(causal: Estimate = CAUSAL, batch: Estimate | None = BATCH, log: Recording | None = None) -> Comparison:
    """Return the comparison of a filter and its optima, as `compare_estimators` does."""
    recording, truth = log or examples.recording(), examples.truth()
    estimates = {"ekf": FILTER, "causal": causal} | ({} if batch is None else {"batch": batch})
    scores = {
        name: evaluate(truth, recording, each, batch if each.kind == "smoothed" else causal)
        for name, each in estimates.items()
    }
    optima = {"filtered": "causal"} | ({} if batch is None else {"smoothed": "batch"})
    return Comparison(truth, recording, estimates, scores, optima)  # pyrefly: ignore[bad-argument-type]


def said_on_optima(comparison: Comparison) -> list[str]:
    """Return the notes on the optima; the table has all notes."""
    found = notes(comparison)
    assert str(table(comparison)).splitlines()[1 + len(comparison.scores) :][: len(found)] == found
    return [line for line in found if not line.startswith(("One run: ", "Empty columns: "))]


def test_metrics_have_the_quality_of_an_optimum():
    causal = replace(CAUSAL, chi_square=6.0, chi_square_dof=4, optimum_check=0.31, association=np.array([4, -1, 9]))
    batch = replace(BATCH, chi_square=8.0, chi_square_dof=4)
    found = metrics(compared(causal, batch), None, None)["estimators"]
    keys = ("optimum_check_sigma", "chi_square_per_dof", "yardstick_check_sigma")
    quality = {name: [found[name][key] for key in keys] for name in found}
    assert quality == {"ekf": [None, None, 0.31], "causal": [0.31, 1.5, 0.31], "batch": [None, 2.0, None]}


def test_an_infinite_check_is_the_largest_double_in_json():
    comparison = compared(replace(CAUSAL, optimum_check=math.inf, chi_square=0.0, chi_square_dof=0))
    found = json.loads(json.dumps(metrics(comparison, None, None), allow_nan=False))["estimators"]
    assert comparison.scores["causal"]["optimum_check_sigma"] == math.inf
    assert found["causal"]["optimum_check_sigma"] == found["ekf"]["yardstick_check_sigma"] == sys.float_info.max
    assert found["causal"]["chi_square_per_dof"] is None  # no degree of freedom


# --- the fit of the model ------------------------------------------------------------------------


def fit(figure: float, dof: int = 14549) -> str | None:
    return fit_of_the_model("hindsight optimum", replace(BATCH, chi_square=figure * dof, chi_square_dof=dof))


def test_the_fit_names_the_optimum_its_degrees_of_freedom_and_the_band():
    low, high = (bound / 14549 for bound in chi2_band(0.95, 14549))
    band = f"(14549 degrees of freedom, 95 % band {low:.3f} to {high:.3f})"
    assert fit(1.02) == f"{FIT} hindsight optimum 1.020 {band}"
    assert given(fit(1.1)).endswith(f" 1.100 {band}, above it: the stated noise is too small, or there are outliers")
    assert given(fit(0.1)).endswith(f" 0.100 {band}, below it: the stated noise is too large")
    assert fit_of_the_model("x", BATCH) is None and fit(1.0, 0) is None and mean_fit("x", None) is None
    assert mean_fit("x", Interval(1.0, 0.9, 1.1)) == f"{FIT} x 1.000 ± 0.100"


@pytest.mark.parametrize("dof", [1, 2, 17, 300, 10**4, 10**6])
def test_the_band_of_the_fit_never_rounds_to_a_point(dof: int):
    said = given(fit(1.0, dof))
    low, high = map(float, said.partition("band ")[2].rstrip(")").split(" to "))
    exact = np.divide(chi2_band(0.95, dof), dof)
    assert np.abs(np.array([low, high]) - exact).max() < 0.05 * np.ptp(exact)
    assert said.endswith(")")


# --- notes and marks -----------------------------------------------------------------------------

LESS = replace(BATCH, association=np.array([-1, -1, 9]))
FITTED = replace(CAUSAL, chi_square=6.0, chi_square_dof=4), replace(BATCH, chi_square=5.0, chi_square_dof=4)


@pytest.mark.parametrize(
    ("comparison", "said"),
    [
        (compared(), []),
        (compared(*FITTED), [f"{FIT} hindsight optimum 1.25 (4 "]),
        (compared(FITTED[0], None), [f"{FIT} causal optimum 1.50 (4 "]),
        (compared(batch=LESS), ["batch leaves out 2 observations"]),
        (compared(batch=LESS, log=BEARINGS), ["batch leaves out 2 observations that bearings do not determine"]),
        (compared(replace(CAUSAL, optimum_check=CHECK_LIMIT)), []),
        (
            compared(replace(CAUSAL, optimum_check=0.312)),
            [f"causal is 0.31 sigma from the optimum at a checked step: {MARKED}"],
        ),
        (
            compared(replace(CAUSAL, optimum_check=math.inf)),
            [f"the optimum of some steps of causal, or that of the whole recording, was not found: {MARKED}"],
        ),
    ],
)
def test_notes_on_the_optima(comparison: Comparison, said: list[str]):
    found = said_on_optima(comparison)
    assert len(found) == len(said)
    assert all(line.startswith(begin) for line, begin in zip(found, said, strict=True))


@pytest.mark.parametrize("title", ["x optimum", "Mahalanobis distance² to the optimum"])
def test_figures_relative_to_an_optimum_in_doubt_are_marked(title: str):
    plain = cells(compared(), title)
    assert not any(MARK in cell for cell in plain.values())
    marked = cells(compared(replace(CAUSAL, optimum_check=0.312)), title)
    assert marked == {name: cell + MARK * (name != "batch") for name, cell in plain.items()}


def cells(comparison: Comparison, title: str) -> dict[str, str]:
    """Return the cells under a title by estimator; figures end under the end of their title, or at a mark."""
    lines = str(table(comparison)).splitlines()
    end = lines[0].index(title) + len(title)
    return {line.split()[0]: line[:end].split("  ")[-1].strip() for line in lines[1 : 1 + len(comparison.scores)]}


def test_a_graph_with_a_filters_associations_is_named_and_marks_nothing():
    comparison = compared()
    comparison.estimates["causal@ekf"] = replace(CAUSAL, optimum_check=2.0)
    assert said_on_optima(comparison) == ["causal@ekf is 2 sigma from the optimum at a checked step"]


@pytest.mark.parametrize(
    ("ratio", "runs", "is_reported"),
    [
        (Interval(0.75, 0.72, 0.78), 20, True),
        (Interval(0.99, 0.965, 1.015), 100, False),
        (Interval(0.95, 0.92, 0.98), 20, False),  # 95 % below, 99.9 % not
        (Interval(0.5, None, None), 1, False),
        (None, 20, False),
    ],
)
def test_ratios_over_runs_that_are_significantly_below_1(ratio: Interval | None, runs: int, is_reported: bool):
    note = beats_the_optimum(ratio, runs)
    assert (note is not None) == is_reported
    if note:
        assert note.startswith("its error is 0.75 ± 0.056 times the causal optimum's (99.9% interval): no filter can")


def test_estimators_as_good_as_the_optimum_are_rarely_reported():
    """The false-alarm rate is 1 in 2000; 0 to 7 of 4000 have a probability of 0.9989 then."""
    rng = np.random.default_rng(0)
    draws = rng.normal(1.0, 0.1, (4000, 2, 20))
    reported = sum(beats_the_optimum(ratio_interval(ours, best), 20) is not None for ours, best in draws)
    assert reported <= 7


@pytest.mark.parametrize(("max_range", "is_told"), [(0.05, True), (10.0, False)])
def test_a_run_without_observations_is_told(max_range: float, is_told: bool) -> None:
    scenario = load_scenario("q1-short-dense", [f"sensor.max_range={max_range}", "trajectory.duration=1"])
    truth, recording = simulate(scenario, 0)
    text = str(table(compare_estimators(truth, recording, load_estimators(["ekf"]))))
    assert ("no landmark was observed: all estimates are dead reckoning" in text) == is_told
