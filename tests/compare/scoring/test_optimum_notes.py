"""Quality of the optima, in metrics.json and in notes under the tables."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.compare.scoring.comparison import Comparison, metrics, notes, table
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval, ratio_interval
from slamgauge.compare.scoring.optimum_notes import CHECK_LIMIT, MARK, beats_the_optimum, fit_of_the_model
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference import example_records as examples
from tests.reference.given import given

FILTER = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.2))
CAUSAL = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.1), nis=None, nis_dof=None)
BATCH = replace(CAUSAL, kind="smoothed")
LOG = examples.recording()
BEARINGS = examples.recording(
    sensor="bearing", observation=np.zeros((3, 1)), observation_cov=np.tile(np.eye(1), (3, 1, 1))
)
BLIND = examples.recording(
    observation_step=[], observation=np.zeros((0, 2)), observation_cov=np.zeros((0, 2, 2)), landmark=[]
)
FIT, MARKED = "fit of the model: chi2/dof of the", "figures relative to it are marked ?"


def compared(
    causal: Estimate = CAUSAL, batch: Estimate | None = BATCH, log: Recording = LOG, **more: Estimate
) -> Comparison:
    """Return the comparison of a filter and its optima, as `compare_estimators` does."""
    truth = examples.truth()
    estimates = {"ekf": FILTER, "causal": causal} | ({} if batch is None else {"batch": batch})
    scores = {
        name: evaluate(truth, log, each, batch if each.kind == "smoothed" else causal)
        for name, each in estimates.items()
    }
    optima = {"filtered": "causal"} | ({} if batch is None else {"smoothed": "batch"})
    return Comparison(truth, log, estimates | more, scores, optima)  # pyrefly: ignore[bad-argument-type]


def test_metrics_have_the_quality_of_an_optimum():
    keys = ("optimum_check_sigma", "chi_square_per_dof", "yardstick_check_sigma")
    for check, dof, written, fit_of_causal in ((0.31, 4, 0.31, 1.5), (math.inf, 0, sys.float_info.max, None)):
        causal = replace(CAUSAL, chi_square=6.0, chi_square_dof=dof, optimum_check=check)
        comparison = compared(causal, replace(BATCH, chi_square=8.0, chi_square_dof=4))
        found = json.loads(json.dumps(metrics(comparison, None, None), allow_nan=False))["estimators"]
        assert [found["ekf"][key] for key in keys] == [None, None, written]
        assert [found["causal"][key] for key in keys] == [written, fit_of_causal, written]
        assert [found["batch"][key] for key in keys] == [None, 2.0, None]


# --- the fit of the model ------------------------------------------------------------------------


def fit(figure: float, dof: int = 14549) -> str | None:
    return fit_of_the_model("hindsight optimum", replace(BATCH, chi_square=figure * dof, chi_square_dof=dof))


def test_the_fit_names_the_optimum_its_degrees_of_freedom_and_the_band():
    low, high = (bound / 14549 for bound in chi2_band(0.95, 14549))
    band = f"(14549 degrees of freedom, 95 % band {low:.3f} to {high:.3f})"
    assert fit(1.02) == f"{FIT} hindsight optimum 1.020 {band}"
    assert given(fit(1.1)).endswith(f" 1.100 {band}, above it: the stated noise is too small, or there are outliers")
    assert given(fit(0.1)).endswith(f" 0.100 {band}, below it: the stated noise is too large")
    assert fit_of_the_model("x", BATCH) is None and fit(1.0, 0) is None
    for dof in (1, 300, 10**6):  # the band never rounds to a point
        low, high = map(float, given(fit(1.0, dof)).partition("band ")[2].rstrip(")").split(" to "))
        exact = np.divide(chi2_band(0.95, dof), dof)
        assert np.abs(np.array([low, high]) - exact).max() < 0.05 * np.ptp(exact)


# --- notes and marks -----------------------------------------------------------------------------

DOUBTFUL = replace(CAUSAL, optimum_check=0.312)
MISFIT = replace(CAUSAL, chi_square=12_000.0, chi_square_dof=10_000)
NOT_FOUND = f"the optimum of some steps of causal, or that of the whole recording, was not found: {MARKED}"
CONTRADICTED = (
    "the residuals of batch and causal contradict the stated noise, so they are not optimal: "
    "figures relative to them are marked ?"
)
LESS = replace(BATCH, association=np.array([-1, -1, 9]))
FITTED = replace(CAUSAL, chi_square=6.0, chi_square_dof=4), replace(BATCH, chi_square=5.0, chi_square_dof=4)


@pytest.mark.parametrize(
    ("comparison", "said", "marks"),
    [
        (compared(), [], "000"),
        (compared(*FITTED), [f"{FIT} hindsight optimum 1.25 (4 "], "000"),
        (compared(FITTED[0], None), [f"{FIT} causal optimum 1.50 (4 "], "00"),
        (compared(batch=LESS), ["batch leaves out 2 observations"], "000"),
        (compared(batch=LESS, log=BEARINGS), ["batch leaves out 2 observations that bearings do not"], "000"),
        (compared(replace(CAUSAL, optimum_check=CHECK_LIMIT)), [], "000"),
        (compared(mine=DOUBTFUL), ["mine is 0.31 sigma from the optimum at a checked step"], "000"),
        (replace(compared(), recording=BLIND), ["no landmark was observed: all estimates are dead"], "000"),
        (compared(DOUBTFUL), [f"causal is 0.31 sigma from the optimum at a checked step: {MARKED}"], "220"),
        (compared(replace(CAUSAL, optimum_check=math.inf)), [NOT_FOUND], "220"),
        (compared(MISFIT, replace(MISFIT, kind="smoothed")), [CONTRADICTED, FIT], "222"),
    ],
)
def test_notes_and_marks(comparison: Comparison, said: list[str], marks: str):
    """Marked are x optimum and the distance to the optimum, if it is in doubt, of ekf, causal and batch."""
    found, lines = notes(comparison), str(table(comparison)).splitlines()
    after = 1 + len(comparison.scores)
    assert lines[after : after + len(found)] == found
    of_optima = [line for line in found if not line.startswith("One run: ")]
    assert len(of_optima) == len(said)
    assert all(line.startswith(begin) for line, begin in zip(of_optima, said, strict=True))
    assert "".join(str(line.count(MARK)) for line in lines[1:after]) == marks


def test_ratios_over_runs_that_are_significantly_below_1_are_reported_and_others_rarely():
    """The false-alarm rate is 1 in 2000; 0 to 7 of 4000 have a probability of 0.9989 then."""
    note = given(beats_the_optimum(Interval(0.75, 0.72, 0.78), 20))
    assert note.startswith("its error is 0.75 ± 0.056 times the causal optimum's (99.9% interval): no filter can")
    for ratio in (None, Interval(0.5, None, None), Interval(0.95, 0.92, 0.98)):  # 95 % below, 99.9 % not
        assert beats_the_optimum(ratio, 20) is None
    rng = np.random.default_rng(0)
    draws = rng.normal(1.0, 0.1, (4000, 2, 20))
    reported = sum(beats_the_optimum(ratio_interval(ours, best), 20) is not None for ours, best in draws)
    assert reported <= 7
