"""What the optima say of themselves, in metrics.json and under the tables."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.compare.scoring.comparison import Comparison, metrics, optimum_notes, table
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.optimum_figures import CHECK_LIMIT
from slamgauge.compare.scoring.optimum_notes import MARK, fit_of_the_model, left_out, mean_fit
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from tests.reference import example_records as examples

FILTER = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.2))
CAUSAL = examples.estimate(association=[4, 4, 9], poses=np.full((3, 3), 0.1), nis=None, nis_dof=None)
BATCH = replace(CAUSAL, kind="smoothed")


def compared(
    causal: Estimate = CAUSAL,
    batch: Estimate | None = BATCH,
    *,
    recording: Recording | None = None,
    truth: Truth | None = None,
) -> Comparison:
    """A filter beside its optima, as `compare_estimators` would have it."""
    recording, truth = recording or examples.recording(), truth or examples.truth()
    estimates = {"ekf": FILTER, "causal": causal} | ({} if batch is None else {"batch": batch})
    scores = {
        name: evaluate(truth, recording, each, batch if each.kind == "smoothed" else causal, batch)
        for name, each in estimates.items()
    }
    optima = {"filtered": "causal"} | ({} if batch is None else {"smoothed": "batch"})
    return Comparison(truth, recording, estimates, scores, optima)  # pyright: ignore[reportArgumentType]


def notes(comparison: Comparison) -> list[str]:
    """What stands of the optima under the table, before all else."""
    found = optimum_notes(comparison)
    assert str(table(comparison)).splitlines()[1 + len(comparison.scores) :][: len(found)] == found
    return found


def test_metrics_tell_how_good_an_optimum_is():
    causal = replace(CAUSAL, chi_square=6.0, chi_square_dof=4, optimum_check=0.31, association=[4, -1, 9])
    batch = replace(BATCH, chi_square=8.0, chi_square_dof=4, association=[-1, -1, 9])
    found = metrics(compared(causal, batch), None, None)["estimators"]
    keys = ("optimum_check_sigma", "chi_square_per_dof", "observations_left_out", "observations_rejected")
    assert [found["causal"][key] for key in keys] == [0.31, 1.5, 1, 1]
    assert [found["batch"][key] for key in keys] == [None, 2.0, 2, 2]
    assert [found["ekf"][key] for key in keys] == [None, None, None, 0]
    assert [found[name]["yardstick_check_sigma"] for name in ("ekf", "causal", "batch")] == [0.31, 0.31, None]


def test_an_optimum_without_a_degree_of_freedom_has_no_fit():
    scores = compared(replace(CAUSAL, chi_square=0.0, chi_square_dof=0)).scores
    assert scores["causal"].figure("chi_square_per_dof") is None


def test_a_check_that_is_infinite_is_the_largest_number_that_json_has():
    comparison = compared(replace(CAUSAL, optimum_check=math.inf))
    assert comparison.scores["causal"].figure("optimum_check_sigma") == math.inf
    text = json.dumps(metrics(comparison, None, None), allow_nan=False)
    found = json.loads(text)["estimators"]
    assert found["causal"]["optimum_check_sigma"] == sys.float_info.max > CHECK_LIMIT
    assert found["ekf"]["yardstick_check_sigma"] == sys.float_info.max


# --- the fit of the model ------------------------------------------------------------------------


def fit(figure: float, dof: int = 14549) -> str | None:
    return fit_of_the_model("hindsight optimum", replace(BATCH, chi_square=figure * dof, chi_square_dof=dof))


def test_the_fit_names_the_optimum_its_degrees_of_freedom_and_the_band():
    low, high = (bound / 14549 for bound in chi2_band(0.95, 14549))
    band = f"(14549 degrees of freedom, 95 % band {low:.3f} to {high:.3f})"
    head = "fit of the model: chi2/dof of the hindsight optimum"
    assert fit(1.02) == f"{head} 1.020 {band}"
    assert fit(1.1) == f"{head} 1.100 {band}, above it: noise is stated too small, or there are outliers"
    assert fit(0.1) == f"{head} 0.100 {band}, below it: noise is stated too large"


@pytest.mark.parametrize("dof", [1, 2, 17, 300, 10**4, 10**6])
def test_the_band_of_the_fit_never_rounds_to_a_point(dof: int):
    said = fit(1.0, dof)
    assert said is not None
    low, high = map(float, said.partition("band ")[2].rstrip(")").split(" to "))
    exact = np.divide(chi2_band(0.95, dof), dof)
    assert np.abs(np.array([low, high]) - exact).max() < 0.05 * np.ptp(exact)
    assert said.endswith(")")


def test_who_does_not_tell_has_no_fit():
    assert fit_of_the_model("x", BATCH) is None
    assert fit(1.0, 0) is None
    assert mean_fit("x", None) is None
    assert mean_fit("x", Interval(1.0, 0.9, 1.1)) == "fit of the model: chi2/dof of the x 1.000 ± 0.100"


def test_the_fit_is_the_hindsight_optimums_if_there_is_one_else_the_causal_ones():
    causal = replace(CAUSAL, chi_square=6.0, chi_square_dof=4)
    batch = replace(BATCH, chi_square=5.0, chi_square_dof=4)
    assert notes(compared(causal, batch))[0].startswith("fit of the model: chi2/dof of the hindsight optimum 1.25 (4 ")
    assert notes(compared(causal, None))[0].startswith("fit of the model: chi2/dof of the causal optimum 1.50 (4 ")


# --- what is left out ----------------------------------------------------------------------------


def test_what_an_optimum_leaves_out_is_counted():
    bearings = examples.recording(
        sensor="bearing", observation=np.zeros((3, 1)), observation_cov=np.tile(np.eye(1), (3, 1, 1))
    )
    less = replace(BATCH, landmark_ids=[9], landmarks=[[1.0, 2.0]], landmark_covs=None, association=[-1, -1, 9])
    said = "batch leaves out 1 landmark and 2 observations"
    assert notes(compared(CAUSAL, less, recording=bearings)) == [f"{said} that bearings alone do not place"]
    assert left_out("batch", None, examples.recording(), less) == said
    assert left_out("batch", examples.truth(), examples.recording(landmark=None), less) == said
    assert left_out("batch", None, examples.recording(landmark=None), less) == "batch leaves out 2 observations"
    assert left_out("batch", None, bearings, replace(CAUSAL, association=[4, -1, 9])) == (
        "batch leaves out 1 observation that bearings alone do not place"
    )


def test_an_optimum_that_uses_all_has_no_note():
    assert notes(compared()) == []


# --- an optimum in doubt -------------------------------------------------------------------------


def cells(comparison: Comparison, title: str) -> dict[str, str]:
    """What the table has under a title, by estimator; figures end under the end of their title, or at a mark."""
    lines = str(table(comparison)).splitlines()
    end = lines[0].index(title) + len(title)
    return {line.split()[0]: line[:end].split("  ")[-1].strip() for line in lines[1 : 1 + len(comparison.scores)]}


@pytest.mark.parametrize("title", ["x optimum", "d to optimum"])
def test_figures_relative_to_an_optimum_in_doubt_are_marked(title: str):
    plain = cells(compared(), title)
    assert not any(MARK in cell for cell in plain.values())
    marked = cells(compared(replace(CAUSAL, optimum_check=0.312)), title)
    assert marked == {name: cell + MARK * (name != "batch") for name, cell in plain.items()}


@pytest.mark.parametrize(
    ("check", "said"),
    [
        (None, []),
        (CHECK_LIMIT, []),
        (0.312, ["causal is 0.31 sigma from the optimum at a checked step: figures relative to it are marked ?"]),
        (
            math.inf,
            [
                "causal has steps whose optimum was not found, or that of the whole recording was not: "
                "figures relative to it are marked ?"
            ],
        ),
    ],
)
def test_a_note_says_why_figures_are_marked(check: float | None, said: list[str]):
    assert notes(compared(replace(CAUSAL, optimum_check=check))) == said


def test_a_graph_under_a_filters_associations_is_named_and_marks_nothing():
    comparison = compared()
    comparison.estimates["causal@ekf"] = replace(CAUSAL, optimum_check=2.0)
    assert notes(comparison) == ["causal@ekf is 2 sigma from the optimum at a checked step"]
