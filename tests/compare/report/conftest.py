"""A browser (Debian's chromium and its driver, see `programs`), and a page of each kind with malicious names."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from slamgauge import compare_estimators, load_estimators, load_scenario, simulate
from slamgauge.compare.figures.publishing import draw_stored
from slamgauge.compare.report.page import pages_of, write_pages
from slamgauge.compare.scoring.comparison import metrics, write_comparison
from slamgauge.compare.storage.staged_folder import begin_folder
from tests.reference.external_programs import program
from tests.reference.result_folders import SCRIPT_NAME, WRITE

USER_NAME = 'own "<b>&amp;'
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# main files of the kinds of results; the page of the exercise is written with its results
KINDS = {
    "study": "summary.json",
    "sweep": "sweep.json",
    "budget": "budget.json",
    "noise": "noise.json",
    "grades": "grades.csv",
    "exercise": "",
}


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


@pytest.fixture(scope="session")
def page_of(tmp_path_factory: pytest.TempPathFactory, run_page: Path) -> Callable[[str], Path]:
    """A function that returns the page of a kind of results, which is made once."""
    made = {"run": run_page}
    parent = tmp_path_factory.mktemp("pages")

    def page(kind: str) -> Path:
        if kind not in made:
            WRITE[kind](parent / kind)
            if KINDS[kind]:
                publish(parent / kind / KINDS[kind])
            made[kind] = parent / kind / "report.html"
        return made[kind]

    return page
