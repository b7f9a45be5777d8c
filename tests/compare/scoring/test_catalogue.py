"""A new metric needs only a decorated function; columns without figures are left out."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate, simulate_informed
from slamgauge.compare.scoring.catalogue import BY_KEY, STORED, Measured, heads
from slamgauge.compare.scoring.comparison import compare_estimators, notes, run_table, table
from slamgauge.compare.scoring.runs import SERIES, Column, Runs, of_run
from slamgauge.compare.studies.study_run import run_once
from slamgauge.compare.studies.summary import Summary, summarise, summary_table

SHORT = ["start=sampled", "trajectory.duration=2"]


def test_every_metric_has_a_meaning():
    assert all(each.key == key and each.help and each.help[-1] != "." for key, each in BY_KEY.items())


def test_a_new_metric_needs_only_a_decorated_function(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(BY_KEY, "way_m", BY_KEY["ate_m"])  # the key is removed at the end

    @of_run(Column("way [m]", form="{:.1f}", run=99, study=99), averaged=True)
    def way_m(found: Measured) -> float:
        """Length of the estimated path."""
        return float(np.linalg.norm(np.diff(found.estimate.poses[:, :2], axis=0)))

    scenario = load_scenario("q1-short-dense", SHORT)
    found = compare_estimators(*simulate(scenario, 0), load_estimators(["dead-reckoning"]))
    way = found.scores["dead-reckoning"]["way_m"]
    assert found.scores["dead-reckoning"].to_json()["way_m"] == way > 0
    head, row, *_ = str(table(found)).splitlines()
    assert head.endswith("way [m]") and row.endswith(f"{way:.1f}")

    (outcome,) = run_once(scenario, 0, ["dead-reckoning"])
    assert outcome.figures["way_m"] == way
    figures = {key: np.full(2, way if key == "way_m" else np.nan) for key in (*STORED, "way_m")}
    entries = summarise({"mine": Runs(np.arange(2), "filtered", figures, dict.fromkeys(SERIES, np.zeros((2, 3))))})
    assert entries["mine"].to_json()["way_m"]["mean"] == pytest.approx(way)
    assert "way [m]" in str(summary_table(Summary("x", 2, 0, "", (), entries))).splitlines()[0]


def test_columns_without_any_figure_are_left_out_and_only_simulated_runs_lead_to_a_study() -> None:
    truth, recording, informed = simulate_informed(load_scenario("q1-long-dense", ["trajectory.duration=2"]), 0)
    errors = {"ATE [m]", "x optimum", "NEES", "in 95% ellipse", "heading [rad]", "end [m]"}
    for known, told, names, empty in (
        (truth, informed, ["batch"], {"NIS/dof"}),
        (truth, None, ["ekf"], {"x optimum", "d to optimum"}),
        (None, None, ["ekf", "batch"], errors),
    ):
        found = compare_estimators(known, recording, load_estimators(names), told)
        shown = {head.title for head in run_table(found.scores).heads}
        assert empty <= {head.title for head in heads("run")} and not empty & shown
        assert "mapped" in shown
        assert any(note.startswith("One run: ") for note in notes(found)) == (known is not None)


def test_the_manual_has_the_tables_of_the_catalogue():
    """`python docs/make_tables.py` writes them."""
    docs = Path(__file__).parents[3] / "docs"
    text = (docs / "glossary.md").read_text(encoding="utf-8")
    assert runpy.run_path(str(docs / "make_tables.py"))["filled"](text) == text
