"""Runs of the exercise: EKF and optima on the same measurements, stored, continued, and shown."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.registry import REGISTRY
from slamgauge.compare.exercise import results
from slamgauge.compare.exercise.results import Exercise, first_closures, run_exercise
from slamgauge.compare.exercise.settings import CAUSAL, EKF, ESTIMATORS, GTSAM, SETTINGS
from slamgauge.compare.exercise.tables import exercise_page
from slamgauge.compare.report import exercise_page as exercise_pages
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.run_arrays import closure_steps
from slamgauge.compare.studies import study
from slamgauge.compare.studies.study_run import run_once, run_seed
from slamgauge.errors import UserError
from tests.reference.given import given

pytestmark = pytest.mark.slow

SECONDS = 25  # duration of every setting here


@pytest.fixture(scope="module", autouse=True)
def short() -> Generator[None]:
    """Shorten the settings; they turn at four times the rate, so that they have loop closures."""

    def shortened(name: str) -> Scenario:
        rate = 0.8 if name == "q1-short-dense" else 0.4
        return load_scenario(name, [f"trajectory.duration={SECONDS}", f"trajectory.yaw_rate={rate}"])

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(results, "load_scenario", shortened)
        yield


@pytest.fixture(scope="module")
def pool():
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture(scope="module")
def question_1(tmp_path_factory: pytest.TempPathFactory, pool: ThreadPoolExecutor) -> Exercise:
    return run_exercise(["q1"], 2, 3, tmp_path_factory.mktemp("question") / "out", pool)


def test_all_estimators_of_a_run_use_the_same_measurements(question_1: Exercise):
    """Stored figures equal those of single runs: filters on the recording, optima with true noise and associations."""
    for ran in question_1.settings:
        for run in range(2):
            seed = run_seed(3, run)
            alone = [
                *run_once(ran.scenario, seed, ESTIMATORS[:2]),
                *run_once(informed(ran.scenario), seed, ESTIMATORS[2:]),
            ]
            for outcome in alone:
                assert ran.study.loaded[outcome.estimator].figures["ate_m"][run] == outcome.figures["ate_m"]


def test_settings_with_the_same_measurements_share_the_optima(tmp_path: Path, pool: ThreadPoolExecutor):
    """Question 2 has three maps, and compares its filter with that of question 1."""
    run_exercise(["q2"], 1, 0, tmp_path, pool)
    folders = {path.name for path in (tmp_path / "studies").iterdir()}
    assert {name for name in folders if not name.startswith("optima-")} == {
        *(each.figure for each in SETTINGS.values() if each.question == "q2"),
        *("2.1", "2.2", "2.3"),
    }
    assert sum(name.startswith("optima-") for name in folders) == 3


def test_loop_closures_are_the_first_of_each_lap(question_1: Exercise):
    """Errors and sigmas at these steps are the RMS over the runs."""
    for ran in question_1.settings:
        rate = 0.8 if ran.setting.figure == "2.1" else 0.4  # rad/s
        every = []
        for run in range(2):
            truth, recording = simulate(ran.scenario, run_seed(3, run))
            steps = given(closure_steps(truth, recording))
            laps = [int((0.1 * rate * step + 1e-6) // (2 * math.pi)) for step in steps]
            firsts = [next((step for step, of in zip(steps, laps, strict=True) if of == lap), -1) for lap in range(9)]
            every.append(firsts[: math.ceil(SECONDS * rate / (2 * math.pi) - 0.01)])
            assert first_closures(ran.scenario, run_seed(3, run)) == every[-1]
        for closure in ran.loop_closures:
            at = [(run, firsts[closure.lap - 1]) for run, firsts in enumerate(every) if firsts[closure.lap - 1] >= 0]
            assert closure.time_s == pytest.approx(0.1 * np.mean([step for _, step in at]))
            series, found = ran.study.loaded[EKF].series, closure.estimators[EKF]
            squares = [[series[f"error_{axis}"][run, step - 1] ** 2 for axis in "xy"] for run, step in at]
            assert found["error_m"][0] == pytest.approx(math.sqrt(np.sum(squares) / len(at)))
            squares = [[series[f"sigma_{axis}"][run, step] ** 2 for axis in "xy"] for run, step in at]
            assert found["three_sigma_m"][1] == pytest.approx(3 * math.sqrt(np.sum(squares) / len(at)))
    assert any(ran.loop_closures for ran in question_1.settings)


def test_tables_fit_80_columns_and_a_ratio_to_an_optimum_in_doubt_is_marked(question_1: Exercise):
    doubted = replace(deepcopy(question_1), failures=["figure 2.1, run 0: ekf failed: x"])
    doubted.settings[1].study.estimators[CAUSAL].figures["optimum_check_share"] = 0.5
    text = exercise_page(doubted).text(80)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert "Hidden columns" not in text
    assert lines[0].startswith("Question 1. Environment, with known association: 2 runs")
    rows = [next(line for line in lines if line.startswith(figure)) for figure in ("1.1", "2.1", "2.2", "2.3")]
    assert ["?" in row for row in rows] == [False, True, False, False]
    assert "2.1: causal is more than 0.05 sigma from the optimum" in " ".join(text.split())
    assert lines[-1] == "figure 2.1, run 0: ekf failed: x"


def test_a_failed_estimator_has_a_line_and_the_others_their_figures(
    tmp_path: Path, pool: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(REGISTRY, GTSAM, replace(REGISTRY[GTSAM], home="slamgauge.errors:UserError"))
    exercise = run_exercise(["q4"], 1, 0, tmp_path, pool)
    assert [line.partition(" failed")[0] for line in exercise.failures] == [
        f"figure {figure}, run 0: gtsam-batch" for figure in ("4.1", "ring")
    ]
    rows = exercise_page(exercise).text(80).splitlines()
    row = next(line for line in rows if line.startswith("4.1")).split()
    assert row[3].startswith("0.") and row[4] == "-"  # errors of EKF and GTSAM batch


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_the_command_writes_results_figures_and_pages_and_continues(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    words = ["exercise", "q4", "--runs", "2", "--out", str(tmp_path / "out"), "--json"]
    assert main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    out = tmp_path / "out"
    assert json.loads((out / "exercise.json").read_text()) == printed
    assert {path.name for path in out.iterdir() if path.name[0] != "."} == {
        *("exercise.json", "report.html", "figure-4.1.png", "figure-ring.png", "q4-nees.png", "studies", "run-0"),
    }
    page = (out / "report.html").read_text()
    for figure in ("4.1", "ring"):
        assert f'href="run-0/{figure}/report.html"' in page
        assert (out / "run-0" / figure / "report.html").is_file()
        metrics = json.loads((out / "run-0" / figure / "metrics.json").read_text())
        assert set(metrics["estimators"]) == {*ESTIMATORS}
    for module, name in ((exercise_pages, "publish_first_run"), (study, "run_once")):
        monkeypatch.setattr(module, name, Mock(side_effect=UserError("not again")))
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out) == printed
    assert main([*words, "--seed", "1"]) == 2
    assert "has a study of another seed" in capsys.readouterr().err


def test_every_key_of_the_json_file_is_documented(question_1: Exercise):
    text = Path(__file__).parents[3].joinpath("docs/exercise.md").read_text(encoding="utf-8")
    rows = "\n".join(line.partition("| ")[2].partition(" |")[0] for line in text.splitlines() if line.startswith("| `"))
    documented = {word for code in re.findall(r"`([^`]+)`", rows) for word in re.findall(r"\w+", code)}
    found = question_1.to_json()
    for setting in found["questions"]["q1"]["settings"]:
        setting["estimators"] = {}  # as in summary.json
    keys = {*re.findall(r'"([^"]+)": ', json.dumps(found))}
    assert keys - {"q1", *ESTIMATORS} <= documented | {"mean", "low", "high"}
