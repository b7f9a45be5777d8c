"""Pages contain the notes that the terminal prints: optima in doubt, misfits, losses of noise estimation."""

from __future__ import annotations

import html
import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import find_noise, load_scenario, simulate
from slamgauge.compare.noise.estimation import Noise
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.noise.tables import noise_page
from slamgauge.compare.report import table_pages
from slamgauge.compare.report.publishing import pages_of
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.studies.budget import RUNGS, budget_table, summarise_budget
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.summary import EstimatorSummary
from slamgauge.compare.studies.sweep import Sweep, sweep_table

from .conftest import unexplained

pytestmark = pytest.mark.slow


def page_of(folder: Path, name: str, content: object) -> str:
    (folder / name).write_text(json.dumps(content))
    text = re.sub(r"<[^>]*>", "", pages_of(folder / name)["report.html"])
    return " ".join(html.unescape(text).split())


def test_every_rung_of_a_budget_with_optima_in_doubt_is_marked(tmp_path: Path):
    """Residuals are three times the stated noise, and optima are in doubt in all runs."""
    errors = np.random.default_rng(0).uniform(1.0, 2.0, (5, len(RUNGS)))
    found = summarise_budget("q1", "ekf", errors, np.ones(errors.shape), np.linspace(2.9, 3.1, len(errors)))
    page = page_of(tmp_path, "budget.json", found.to_json())
    notes = [part for part in budget_table(found).parts[2:] if isinstance(part, str)]
    assert any("so they are not optimal" in line for line in notes)
    assert [line for line in notes if line not in page] == []
    assert len(re.findall(r"[+-]\d\.\d{5}\?", page)) == len(RUNGS)


def test_a_sweep_is_marked_where_its_optimum_is_in_doubt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    scenario = load_scenario("q1-short-dense", ["start=sampled", "trajectory.duration=3"])
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(scenario, 2, 0, ["ekf", "causal"], tmp_path / "study", executor)
    changed = {"chi_square_per_dof": Interval(3.0, 2.9, 3.1), "faults": ("diverges",)}
    optimum = EstimatorSummary({**summary.estimators["causal"], **changed})
    misfit = replace(summary, estimators={**summary.estimators, "causal": optimum})
    sweep = Sweep("q1", "assumed.scale", 2, 0, ("1", "2"), (summary, misfit))
    monkeypatch.setattr(table_pages, "read_sweep", lambda _: sweep)
    page = page_of(tmp_path, "sweep.json", sweep.to_json())
    notes = [part for part in sweep_table(sweep).parts if isinstance(part, str)]
    assert any("diverges at assumed.scale=2" in line for line in notes)
    assert any("assumed.scale=2: the residuals of causal" in line for line in notes)
    assert [line for line in notes if line not in page] == []
    assert len(re.findall(r"\d\?", page)) == 2  # `x causal` of both estimators at the second value


def test_the_page_of_noise_notes_a_held_out_loss(tmp_path: Path):
    recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=5", "start=sampled"]), 4)[1]
    found = find_noise(recording)
    assert found.held_out is not None
    losing = found.held_out._replace(log_likelihood_gain=-3.5)
    noise: Noise = replace(found, held_out=losing)
    page = page_of(tmp_path, "noise.json", noise_json(noise))
    notes = [part for part in noise_page(noise_json(noise)).parts if isinstance(part, str)]
    (tmp_path / "report.html").write_text(pages_of(tmp_path / "noise.json")["report.html"], encoding="utf-8")
    assert unexplained(tmp_path / "report.html") == []
    assert any("this is a loss, and the assumed noise is kept" in line for line in notes)
    assert [line for line in notes if line not in page] == []
