"""The page of a study in a real browser, and the other pages with malicious names."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import UserError, load_scenario
from slamgauge.compare.cli.main import main
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.report.grade_page import FIGURES
from slamgauge.compare.report.publishing import pages_of
from slamgauge.compare.report.rerun_command import command_of_run
from slamgauge.compare.storage.best_effort import decorate
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.budget import RUNGS, summarise_budget
from slamgauge.compare.studies.stored_study import StoredStudy, load_study
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import Request, Summary
from tests.reference import fast_commands

from .conftest import SCRIPT_NAME, Reader, publish, unexplained

pytestmark = pytest.mark.slow

RUNS = 4
NOW = "return document.getElementById(arguments[0]).textContent"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of four short runs of two estimators, with its page."""
    folder = tmp_path_factory.mktemp("study")
    scenario = load_scenario("q1-short-dense", ["start=sampled", "trajectory.duration=5"])
    chosen = ["ekf", "causal"]
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(scenario, RUNS, 0, chosen, folder, executor, against=["ekf"])
    assert write_study(folder, summary, load_runs(scenario, RUNS, 0, chosen, folder), scenario.trajectory.step)
    publish(folder / "summary.json")
    return folder


@pytest.fixture
def opened(reader: Reader, folder: Path) -> Generator[Reader]:
    reader.requests()
    reader.open(folder / "report.html")
    yield reader
    assert reader.complaints() == []


def require_written_summary(folder: Path) -> StoredStudy:
    """Load a study and compare its entries with summary.json."""
    study = load_study(folder)
    written = json.loads((folder / "summary.json").read_text())
    for name, entry in study.summary.estimators.items():
        assert json.loads(json.dumps(entry.to_json())) == written["estimators"][name]
    return study


def test_a_stored_study_gives_the_written_summary(folder: Path):
    assert require_written_summary(folder).step == 0.1


def test_a_store_of_another_study_is_an_error(folder: Path, tmp_path: Path):
    (tmp_path / "study.sqlite").write_bytes((folder / "study.sqlite").read_bytes())
    summary = json.loads((folder / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps({**summary, "digest": "0" * 64}))
    with pytest.raises(UserError, match="has another study than the summary in this folder"):
        pages_of(tmp_path / "summary.json")


def test_the_page_of_a_study_loads_nothing_else_and_begins_with_the_verdicts(opened: Reader, folder: Path):
    page = folder / "report.html"
    assert opened.requests() == [page.as_uri()]
    assert page.stat().st_size <= 8_000_000
    first = opened.run("return document.querySelector('main').firstElementChild.textContent")
    assert "ekf: " in first
    assert opened.run("return document.querySelectorAll('#runs tbody tr').length") == RUNS
    assert opened.run("return document.querySelectorAll('#against-0 tbody tr').length") == 1


def test_pages_of_many_runs_explain_every_column(folder: Path, sweep: Path):
    assert unexplained(folder / "report.html", "ekf", "causal") == []
    assert unexplained(sweep / "report.html") == []


def test_a_click_shows_the_values_and_keys_select_a_run_with_its_command(opened: Reader):
    opened.run(
        """const canvas = document.getElementById('study-nees'), box = canvas.getBoundingClientRect();
        canvas.setPointerCapture = () => {};
        const at = {clientX: box.left + box.width / 2, clientY: box.top + 50};
        canvas.dispatchEvent(new PointerEvent('pointerdown', at));"""
    )
    assert opened.run(NOW, "nees-now").startswith("t = 2.")
    opened.run(
        "document.getElementById('study-errors').dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}))"
    )
    assert opened.run(NOW, "run-now").startswith("run 0: ekf ")
    assert f"--seed {run_seed(0, 0)}" in opened.run(NOW, "run-command")


def test_a_click_selects_the_nearest_run(opened: Reader):
    opened.run(
        """const canvas = document.getElementById('study-errors'), box = canvas.getBoundingClientRect();
        for (let x = 0; x < box.width && document.getElementById('run-now').textContent === ''; x += 8)
          for (let y = 0; y < box.height - 36; y += 8)
            canvas.dispatchEvent(new PointerEvent('pointerdown', {clientX: box.left + x, clientY: box.top + y}));"""
    )
    assert opened.run(NOW, "run-now").startswith("run ")


def test_an_estimator_of_a_study_is_hidden_and_shown(opened: Reader):
    pixels = "return document.getElementById('study-nees').toDataURL()"
    shown = opened.run(pixels)
    opened.run("document.querySelector('.toggle').click()")
    assert opened.run(pixels) != shown
    opened.run("document.querySelector('.toggle').click()")
    assert opened.run(pixels) == shown


def test_a_study_fits_a_narrow_screen(reader: Reader, folder: Path):
    reader.open(folder / "report.html", width=360)
    assert reader.run("return document.documentElement.scrollWidth") <= 360
    assert reader.complaints() == []


def test_the_command_of_a_run_has_the_settings_of_the_study():
    request = Request("my map.toml", ("a.b=1", "c=[1, 2]"), "ekf,mine.py:f", "association.gate=4")
    summary = Summary("my map", 9, 0, "", (), {}, request=request)
    expected = "'my map.toml' --seed 7 --set a.b=1 'c=[1, 2]' association.gate=4 --estimators ekf,mine.py:f"
    assert command_of_run(summary, 7) == f"slamgauge run {expected}"
    assert "add the --set options of the study" in command_of_run(replace(summary, request=None), 7)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep with two short runs at each of two scales."""
    folder = tmp_path_factory.mktemp("sweeps") / "sweep"
    words = ["study", "q1-short-dense", "--runs", "2", "--jobs", "1", "--set", "trajectory.duration=3"]
    with fast_commands.studies_in_a_thread(), fast_commands.empty_pictures():
        words += ["--estimators", "ekf,causal", "--sweep", "assumed.scale=1,2", "--out", str(folder)]
        assert main(words) == 0
    return folder


def test_the_page_of_a_sweep_links_to_the_pages_of_its_values(reader: Reader, sweep: Path):
    reader.open(sweep / "report.html")
    assert reader.run("return [...document.querySelectorAll('#sweep a')].length") == 4
    reader.run("document.querySelectorAll('#sweep a')[2].click()")
    title = reader.run("return document.querySelector('h1').textContent")
    assert title == "q1-short-dense at assumed.scale=2, 2 runs"
    assert reader.run("return document.querySelectorAll('#summary tbody tr').length") == 2
    assert "assumed.scale=2" in reader.run("return document.querySelector('#worst').textContent")
    assert reader.complaints() == []


def test_a_value_of_a_sweep_is_a_study_that_needs_the_stored_optimum(sweep: Path, tmp_path: Path):
    assert [*require_written_summary(sweep / "assumed.scale=2").runs] == ["ekf", "causal"]
    assert len([*sweep.rglob("report.html")]) == 3
    (tmp_path / "alone").mkdir()
    for name in ("summary.json", "study.sqlite"):
        (tmp_path / "alone" / name).write_bytes((sweep / "assumed.scale=2" / name).read_bytes())
    with pytest.raises(UserError, match="has no run of causal; give the command of the study again"):
        load_study(tmp_path / "alone")


def budget(folder: Path) -> None:
    errors = np.random.default_rng(0).uniform(1.0, 2.0, (5, len(RUNGS)))
    found = summarise_budget(SCRIPT_NAME, "ekf", errors, np.full(errors.shape, np.nan), np.ones(len(errors)))
    (folder / "budget.json").write_text(json.dumps(found.to_json()))


def grades(folder: Path) -> None:
    row = {"submission": 'a "<b>', "passed": "false", "graded": "true", "reason": f"{SCRIPT_NAME}; two"}
    row |= {"points": "47", "max_points": "100", "remarks": 'same "<i>" figures', "settings": "Q of the file <b>"}
    row |= {"failed_checks": "heading-wrap", "seconds_per_run": "0.5", "seed": "7", "digest": "of q1-long-dense"}
    row |= {f"{key}{end}": "" for key, *_ in FIGURES for end in ("", "_low", "_high")}
    row |= {"ate_m": "0.3", "ate_m_low": "0.2", "ate_m_high": "0.4"}
    with (folder / "grades.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, row)
        table.writeheader()
        table.writerow(row)
    (folder / "submissions").mkdir()
    (folder / "submissions" / f"{row['submission']}.md").write_text(f"# {SCRIPT_NAME}\n")


@pytest.mark.parametrize(("write", "main", "count"), [(budget, "budget.json", 1), (grades, "grades.csv", 2)])
def test_pages_of_tables_escape_user_given_names(
    reader: Reader, write: Callable[[Path], None], main: str, count: int, tmp_path: Path
):
    write(tmp_path)
    publish(tmp_path / main)
    pages = sorted(tmp_path.rglob("*.html"))
    assert len(pages) == count
    for page in pages:
        assert unexplained(page) == []
        reader.open(page, width=360)
        assert reader.complaints() == []
        assert reader.run("return document.documentElement.scrollWidth") <= 360
        assert reader.run("return document.querySelectorAll('script').length") == 2
        if write is not budget:
            assert {"7", "of q1-long-dense"} <= set(
                reader.run("return [...document.querySelectorAll('.origin dd')].map(each => each.textContent)")
            )
    assert SCRIPT_NAME in reader.run("return document.body.textContent")


def test_the_page_of_grades_links_to_the_submissions(reader: Reader, tmp_path: Path):
    grades(tmp_path)
    publish(tmp_path / "grades.csv")
    reader.open(tmp_path / "report.html")
    reader.run("document.querySelector('#grades a').click()")
    assert reader.run("return document.querySelector('h1').textContent") == 'a "<b>: not passed'
    checks = reader.run("return document.querySelector('#checks tbody').textContent")
    assert "heading-wrap" in checks
    assert "the wrapping of the heading" in checks


def test_results_are_kept_if_the_page_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    begin_folder(tmp_path)
    (tmp_path / "budget.json").write_text("{}")
    assert not decorate(tmp_path, {"report": lambda _: pages_of(tmp_path / "budget.json")}, ["report.html"])
    assert "budget.json: written by another version, or changed by hand" in capsys.readouterr().err
    assert (tmp_path / "budget.json").exists()
