"""A browser (Debian's chromium and its driver, see `programs`), and a page of each kind with malicious names."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from slamgauge import compare_estimators, find_noise, load_estimators, load_scenario, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.exercise import running
from slamgauge.compare.exercise.running import run_exercise
from slamgauge.compare.figures.publishing import draw_stored, write_study
from slamgauge.compare.noise.noise_json import noise_json
from slamgauge.compare.report.exercise_page import publish_exercise
from slamgauge.compare.report.exercise_runs import publish_first_runs
from slamgauge.compare.report.grade_page import FIGURES
from slamgauge.compare.report.publishing import pages_of, write_pages
from slamgauge.compare.scoring.comparison import metrics, write_comparison
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.budget import RUNGS, summarise_budget
from slamgauge.compare.studies.study import load_runs, run_study
from tests.reference import fast_commands
from tests.reference.external_programs import program

SCRIPT_NAME = "<script>alert(1)</script>"
USER_NAME = 'own "<b>&amp;'
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
RUNS = 4


class Reader:
    """A browser that records console messages and network requests."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def open(self, page: Path, *, width: int = 1280, dark: bool = False) -> None:
        self.complaints()  # drop messages of earlier pages
        self.command("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", media="", features=[scheme])
        self.driver.get(page.as_uri())

    def run(self, script: str, *arguments: object) -> Any:
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str) -> Any:
        """Return the value that an asynchronous script passes to its callback."""
        return self.driver.execute_async_script(script)

    def command(self, name: str, **arguments: object) -> Any:
        return self.driver.execute_cdp_cmd(name, arguments)

    def complaints(self) -> list[str]:
        """Return console messages since the last call."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Return requested addresses since the last call, except data URLs."""
        messages = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        found = [each["params"]["request"]["url"] for each in messages if each["method"] == "Network.requestWillBeSent"]
        return [url for url in found if not url.startswith("data:")]


@pytest.fixture(scope="session")
def reader() -> Generator[Reader]:
    browser, driver = program("chromium", *BROWSERS), program("chromium-driver", "chromedriver")
    os.environ.update(SE_OFFLINE="true", SE_AVOID_STATS="true")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    opened = webdriver.Chrome(options=options, service=Service(driver))
    opened.set_script_timeout(60)
    yield Reader(opened)
    opened.quit()


def publish(main: Path) -> None:
    """Write the pages of results next to their main file."""
    write_pages(main.parent, pages_of(main))


@pytest.fixture(scope="session")
def run_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a run."""
    truth, recording = simulate(load_scenario("q1-long-dense", ["start=mean"]), 0)
    estimators = load_estimators(["dead-reckoning", "ekf", "riekf", "causal", "batch"], frames=240)
    named = {USER_NAME if name == "riekf" else name: each for name, each in estimators.items()}
    comparison = compare_estimators(truth, recording, named)
    folder = tmp_path_factory.mktemp("run")
    begin_folder(folder)
    write_comparison(folder, comparison, metrics(comparison, SCRIPT_NAME, 0))
    assert draw_stored(folder, "metrics.json")
    publish(folder / "metrics.json")
    return folder / "report.html"


def study(folder: Path) -> None:
    """Write a study of four short runs of two estimators."""
    begin_folder(folder)
    scenario, chosen = load_scenario("q1-short-dense", ["start=sampled", "trajectory.duration=5"]), ["ekf", "causal"]
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(scenario, RUNS, 0, chosen, folder, executor, against=["ekf"])
    runs = load_runs(scenario, RUNS, 0, chosen, folder)
    assert write_study(folder, summary, runs, scenario.trajectory.step)
    publish(folder / "summary.json")


def sweep(folder: Path) -> None:
    """Write a sweep with two short runs at each of two scales."""
    words = ["study", "q1-short-dense", "--runs", "2", "--jobs", "1", "--set", "trajectory.duration=3"]
    with fast_commands.studies_in_a_thread(), fast_commands.empty_pictures():
        words += ["--estimators", "ekf,causal", "--sweep", "assumed.scale=1,2", "--out", str(folder)]
        assert main(words) == 0


def budget(folder: Path) -> None:
    folder.mkdir()
    errors = np.random.default_rng(0).uniform(1.0, 2.0, (5, len(RUNGS)))
    found = summarise_budget(SCRIPT_NAME, "ekf", errors, np.full(errors.shape, np.nan), np.ones(len(errors)))
    (folder / "budget.json").write_text(json.dumps(found.to_json()))
    publish(folder / "budget.json")


def noise(folder: Path) -> None:
    folder.mkdir()
    recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=5", "start=sampled"]), 4)[1]
    (folder / "noise.json").write_text(json.dumps(noise_json(find_noise(recording))))
    publish(folder / "noise.json")


def grades(folder: Path) -> None:
    (folder / "submissions").mkdir(parents=True)
    row = {"submission": 'a "<b>', "passed": "false", "graded": "true", "reason": f"{SCRIPT_NAME}; two"}
    row |= {"points": "47", "max_points": "100", "remarks": 'same "<i>" figures', "settings": "Q of the file <b>"}
    row |= {"failed_checks": "heading-wrap", "seconds_per_run": "0.5", "seed": "7", "digest": "of q1-long-dense"}
    row |= {f"{key}{end}": "" for key, *_ in FIGURES for end in ("", "_low", "_high")}
    row |= {"ate_m": "0.3", "ate_m_low": "0.2", "ate_m_high": "0.4"}
    with (folder / "grades.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, row)
        table.writeheader()
        table.writerow(row)
    (folder / "submissions" / f"{row['submission']}.md").write_text(f"# {SCRIPT_NAME}\n")
    publish(folder / "grades.csv")


def exercise(folder: Path) -> None:
    """Write question 3 with two short runs, without the figures of run 0."""
    begin_folder(folder)
    with ThreadPoolExecutor(1) as pool, pytest.MonkeyPatch.context() as patched, fast_commands.empty_pictures():
        patched.setattr(running, "load_scenario", lambda name: load_scenario(name, ["trajectory.duration=4"]))
        ran = run_exercise(["q3"], 2, 0, folder, pool)
        publish_first_runs(ran.settings, 0, folder, pool)
        assert publish_exercise(folder, ran)


KINDS: dict[str, Callable[[Path], None]] = {
    each.__name__: each for each in (study, sweep, budget, noise, grades, exercise)
}


@pytest.fixture(scope="session")
def page_of(tmp_path_factory: pytest.TempPathFactory, run_page: Path) -> Callable[[str], Path]:
    """A function that returns the page of a kind of results, which is made once."""
    made = {"run": run_page}
    parent = tmp_path_factory.mktemp("pages")

    def page(kind: str) -> Path:
        if kind not in made:
            KINDS[kind](parent / kind)
            made[kind] = parent / kind / "report.html"
        return made[kind]

    return page
