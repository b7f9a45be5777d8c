"""Paired comparisons of the estimators of a study, and the runs that they need."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scoring.intervals import Interval, compare_paired, needed_runs, ratio_interval
from slamgauge.compare.scoring.runs import FIRST_STEP, Runs
from slamgauge.compare.studies.study import load_runs
from slamgauge.compare.studies.summary import Summary, summary_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.given import given

pytestmark = pytest.mark.slow

Run = Callable[..., Summary]

SHORT = ["start=sampled", "trajectory.duration=3"]
NAMES = ("ekf", "riekf", "dead-reckoning")


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("q1-long-dense", SHORT)


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_pairs_are_those_of_the_stored_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ["study", "q1-long-dense", "--set", "trajectory.duration=3", "--jobs", "1", "--runs", "6"]
    words += ["--estimators", ",".join(NAMES), "--against", "ekf", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert "\nagainst ekf " in capsys.readouterr().out
    against = json.loads((tmp_path / "out/summary.json").read_text())["against"]
    assert {name: [*others] for name, others in against.items()} == {"ekf": ["riekf", "dead-reckoning"]}
    runs = load_runs(load_scenario("q1-long-dense", SHORT), 6, 0, NAMES, tmp_path / "out")
    for label, found in against["ekf"].items():
        for key, figures in (("ate_m", ates), ("nees_pose_per_dof", late_nees)):
            expected = compare_paired(figures(runs[label]), figures(runs["ekf"]))
            assert expected is not None
            assert found[key]["runs"] == 6
            assert found[key]["difference"] == pytest.approx(vars(expected.difference))
            assert found[key]["p_value"] == pytest.approx(expected.p_value)
    assert main([*words, "--sweep", "association.gate=1,9"]) == 2
    assert "sweep: takes no --against" in capsys.readouterr().err


def ates(runs: Runs) -> Float:
    return runs.figures["ate_m"]


def late_nees(runs: Runs) -> Float:
    return runs.series["nees_pose"][:, FIRST_STEP:].mean(axis=1) / 3


def test_a_study_ends_with_a_comparison_of_user_code_with_built_in_filters(run: Run):
    """User code is not compared with optima, dead reckoning or estimates of another kind."""
    ekf = load_estimators(["ekf"])["ekf"]

    def worse(recording: Recording) -> Estimate:
        estimate = ekf(recording)
        return replace(estimate, poses=estimate.poses + np.array([1.0, 0.0, 0.0]))

    chosen = {name: name for name in ("ekf", "dead-reckoning", "causal", "batch")} | {"same": ekf, "worse": worse}
    summary = run(8, chosen)
    ratio = ratio_interval(ates(summary.loaded["worse"]), ates(summary.loaded["ekf"]))
    assert ratio is not None and ratio.low is not None and ratio.low > 1
    assert str(summary_table(summary)).splitlines()[-2:] == [
        "the ATE of same is 1.000 ± 0.000 times that of ekf on the same 8 runs (95 % interval): "
        "the difference is not significant",
        f"the ATE of worse is {ratio.mean:.3f} ± {ratio.mean - ratio.low:.3f} times that of ekf on the same 8 runs "
        "(95 % interval): the difference is significant",
    ]
    assert run(1, {"ekf": "ekf", "same": ekf}).comparisons == (
        ("same", "the ATE of same is 1.000 times that of ekf on the same 1 run; an interval needs 2 runs"),
    )


def test_a_study_prints_how_many_runs_a_ratio_needs_that_is_not_significant(run: Run):
    """The ratios of `iekf` and of its copy are known to 5 % after 8 runs, the one of dead reckoning is not."""
    chosen = {name: name for name in ("ekf", "iekf", "dead-reckoning")} | {"mine": load_estimators(["iekf"])["iekf"]}
    summary = run(8, chosen, against=["ekf"])
    ratios = {label: found["ate_m"].ratio for label, found in summary.against["ekf"].items()}
    widths = {label: width(ratio) for label, ratio in ratios.items()}
    assert widths["mine"] == widths["iekf"] < 0.1 < widths["dead-reckoning"]
    below, mine, _ = str(summary_table(summary)).splitlines()[-3:]
    needed = needed_runs(given(ratios["dead-reckoning"]), 8)
    assert needed
    assert below == f"dead-reckoning against ekf: x ATE is not significant{needed}"
    assert mine.endswith("times that of ekf on the same 8 runs (95 % interval): the difference is not significant")
    ((_, few),) = run(3, {"ekf": "ekf", "mine": chosen["mine"]}).comparisons
    assert re.search(r": the difference is not significant: about \d+ runs are needed to know it to 5 %$", few)


def width(interval: Interval | None) -> float:
    assert interval is not None and interval.low is not None and interval.high is not None
    return interval.high - interval.low


def test_an_unknown_reference_is_refused_before_anything_is_written(run: Run, tmp_path: Path):
    with pytest.raises(UserError, match="'riekf': is not among --estimators; choose from ekf"):
        run(5, ["ekf"], "out", against=["riekf"])
    assert not (tmp_path / "out").exists()
