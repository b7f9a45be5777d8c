"""Pages: their HTML, and a page of each kind in a real browser, opened from disk (Debian's chromium and its driver)."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait

from slamgauge.compare.report.page import (
    ASSETS,
    MODULES,
    PAGES,
    Page,
    json_text,
    pack,
    pages_of,
    program,
    render,
    write_pages,
)
from slamgauge.compare.report.study_pages import command_of_run
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.summary import Request, Summary
from slamgauge.errors import UserError
from tests.reference.result_folders import SCRIPT_NAME, USER_NAME, WRITE

pytestmark = pytest.mark.slow

PageOf = Callable[[str], Path]
KINDS = ("ranges", "study", "sweep", "budget", "noise", "grades", "exercise")
SCRUB = """const scrub = document.getElementById('scrub');
scrub.value = arguments[0]; scrub.dispatchEvent(new Event('input'));"""
PICTURE = "return document.getElementById('map-canvas').toDataURL()"
NAMELESS = """return [...document.querySelectorAll('button, select, input, canvas, img, [role=region]')]
.filter((each) => !(each.textContent.trim() || each.getAttribute('aria-label') || each.alt || each.labels?.length))
.map((each) => each.outerHTML)"""
SORTED = """const table = document.querySelector('table');
table.querySelectorAll('thead button')[arguments[0]].click();
return [table.querySelector('th[aria-sort]').getAttribute('aria-sort'),
  [...table.tBodies[0].rows].map((row) => row.cells[arguments[0]].dataset.value ?? null)];"""


def installed(package: str, *names: str) -> str:
    """Return the path of the first installed program of these names; CONTRIBUTING.md lists them.

    Without one the test is skipped, or fails with SLAMGAUGE_PROGRAMS=required, which `.ci/run` sets.
    """
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        end = pytest.fail if os.environ.get("SLAMGAUGE_PROGRAMS") == "required" else pytest.skip
        end(f"no {names[0]} on the PATH; install Debian's package {package}")
    return found


@pytest.fixture(scope="module")
def browser() -> Generator[webdriver.Chrome]:
    """A browser that logs console messages, also those about anything that the policy of a page forbids."""
    driver = installed("chromium-driver", "chromedriver")
    os.environ.update(SE_OFFLINE="true", SE_AVOID_STATS="true")
    options = webdriver.ChromeOptions()
    options.binary_location = installed("chromium", "chromium", "chromium-browser", "google-chrome")
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with webdriver.Chrome(options=options, service=Service(driver)) as opened:
        yield opened


def show(browser: webdriver.Chrome, page: Path, width: int = 1280) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(page.as_uri())


@pytest.fixture(scope="module")
def page_of(tmp_path_factory: pytest.TempPathFactory) -> PageOf:
    """A function that returns the page of a kind of results, which is made once."""
    parent = tmp_path_factory.mktemp("pages")

    def page(kind: str) -> Path:
        folder = parent / kind
        if not folder.exists():
            WRITE[kind](folder)
            for main in (folder / name for name in PAGES if (folder / name).exists()):
                write_pages(folder, pages_of(main))
        return folder / "report.html"

    return page


# --- HTML ------------------------------------------------------------------------------------------


def test_a_page_has_at_most_three_megabytes_escapes_names_and_allows_only_its_own_script_and_style(page_of: PageOf):
    assert page_of("ranges").stat().st_size <= 3_000_000
    text = page_of("ranges").read_text(encoding="utf-8")
    assert re.findall(r'<script type="(.*?)"', text) == ["application/json", "module"]
    assert f"<h1>{html.escape(SCRIPT_NAME)}, seed 0</h1>" in text
    assert f">{html.escape(USER_NAME).replace('&quot;', '&#34;')}</th>" in text
    markup = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", text, flags=re.DOTALL)
    assert not re.findall(r"<(?:b|script)\b|<[^>]* (?:style|on\w+)=", markup)
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)
    rules = dict(each.strip().split(" ", 1) for each in policy.replace("&#39;", "'").split(";"))
    assert rules["default-src"] == "'none'" and "unsafe" not in policy
    for kind, rule in (("style", "style-src"), ('script type="module"', "script-src")):
        (inlined,) = re.findall(rf"<{kind}>(.*?)</{kind.split()[0]}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(inlined.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"


def test_data_and_texts_of_a_page_are_unchanged_and_cannot_end_an_element():
    data = {"name": "</script><!-- & \u2028", "list": [1.5, None]}
    text = json_text(data)
    assert json.loads(text) == data
    assert not set("<>&") & set(text)
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text({"figure": float("nan")})
    values = np.array([[1.0, np.nan], [-2.5, 3e7]])
    read = np.frombuffer(base64.b64decode(pack(values)["data"]), dtype="<f4").reshape(2, 2)
    np.testing.assert_array_equal(read, values)
    assert r"a\x1bb\udcff" in render(Page("k", "a\x1bb\udcff", [], []))


def test_the_script_evaluates_nothing_and_loads_nothing():
    forbidden = (
        r"\beval\b|new Function|innerHTML|insertAdjacentHTML|document\.write|fetch\(|https?:|^(?:import|export) "
    )
    assert not re.findall(forbidden, program(), re.MULTILINE)


def test_typescript_finds_no_error_in_the_modules():
    words = [installed("node-typescript", "tsc"), "-p", "jsconfig.json", "--noEmit", "--listFiles"]
    found = subprocess.run(words, cwd=str(ASSETS), capture_output=True, text=True, check=False).stdout.splitlines()
    assert {Path(line).stem for line in found if line.endswith(".js")} == set(MODULES)
    assert [line for line in found if not line.endswith((".js", ".d.ts"))] == []


def test_the_command_of_a_run_has_the_settings_of_the_study():
    request = Request("my map.toml", ("a.b=1", "c=[1, 2]"), "ekf,mine.py:f", "association.gate=4")
    summary = Summary("my map", 9, 0, "", (), {}, request=request)
    expected = "'my map.toml' --seed 7 --set a.b=1 'c=[1, 2]' association.gate=4 --estimators ekf,mine.py:f"
    assert command_of_run(summary, 7) == f"slamgauge run {expected}"
    assert "add the --set options of the study" in command_of_run(replace(summary, request=None), 7)


def test_a_page_of_other_results_is_refused(page_of: PageOf, tmp_path: Path):
    study, value = page_of("study").parent, page_of("sweep").parent / "assumed.scale=2"
    assert [*load_study(value).runs] == ["ekf", "causal"]  # the optimum is stored beside the value
    for summary, store, message in (
        (value, study, "has another study than the summary in this folder"),
        (value, value, "has no run of causal; give the command of the study again"),
    ):
        shutil.copy(summary / "summary.json", tmp_path)
        shutil.copy(store / "study.sqlite", tmp_path)
        with pytest.raises(UserError, match=message):
            load_study(tmp_path)


# --- in a browser ----------------------------------------------------------------------------------


@pytest.mark.browser
@pytest.mark.parametrize("kind", KINDS)
def test_a_page_of_each_kind_loads_without_errors_explains_its_columns_and_sorts(
    browser: webdriver.Chrome, page_of: PageOf, kind: str
):
    page = page_of(kind)
    for each in {page, *page.parent.glob("submissions/*.html")}:
        show(browser, each)
        levels = browser.execute_script("return [...document.querySelectorAll('h1, h2, h3')].map((h) => +h.tagName[1])")
        assert levels.count(1) == 1 and all(after - before <= 1 for before, after in itertools.pairwise(levels))
        assert browser.execute_script(NAMELESS) == []
        heads = browser.execute_script("return document.querySelector('table').tHead.rows[0].cells.length")
        for column, order in itertools.product(range(heads), ("ascending", "descending")):
            found, values = browser.execute_script(SORTED, column)
            known = [float(value) for value in values if value is not None]
            assert (found, known) == (order, sorted(known, reverse=order == "descending"))
            assert None not in values[: len(known)] or not known  # cells without a number come last
        show(browser, each, width=360)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 360
        assert browser.get_log("browser") == []
        text = each.read_text(encoding="utf-8")
        links = [unquote(html.unescape(link)) for link in re.findall(r'href="([^"#:]+)"', text)]
        assert [link for link in links if not (each.parent / link).is_file()] == []
        assert links or kind not in ("sweep", "grades", "exercise")  # links to values, submissions and replays
        patterns = ('<th scope="col"[^>]*>(.*?)</th>', "<dt>(.*?)</dt><dd>")
        titles, terms = ({html.unescape(found) for found in re.findall(pattern, text)} for pattern in patterns)
        assert titles - terms <= ({"ekf", "causal", "batch"} if kind == "study" else set())  # columns of estimators


@pytest.mark.browser
def test_a_run_is_replayed(browser: webdriver.Chrome, page_of: PageOf):
    show(browser, page_of("ranges"))
    play, now, scrub, follow = (browser.find_element("id", name) for name in ("play", "now", "scrub", "follow"))

    def frame() -> int:
        return int(str(scrub.get_property("value")))

    def picture() -> str:
        return browser.execute_script(PICTURE)

    before = picture()
    play.click()
    assert play.text == "Pause"
    WebDriverWait(browser, 60).until(lambda _: frame() > 10)
    play.click()
    paused = frame()
    assert picture() != before and play.text == "Play"
    browser.execute_script(SCRUB, 290)
    assert paused < frame() == 290 and re.match(r"t = 29 s, step 290: ekf \d\.\d+ m", now.text)
    for canvas in ("error-panel", "nees-panel", "nis-panel", "timeline"):
        browser.execute_script(SCRUB, 0)
        browser.find_element("id", canvas).click()
        assert (canvas, frame()) == (canvas, pytest.approx(150, abs=15))
    for key, expected in ((Keys.HOME, 0), (Keys.ARROW_RIGHT, 1), (Keys.END, 300), (Keys.ARROW_LEFT, 299)):
        browser.find_element("tag name", "body").send_keys(key)
        assert frame() == expected
    browser.execute_script(SCRUB, 150)
    shown = picture()
    follow.click()
    assert picture() != shown
    browser.find_element("id", "whole").click()
    for button in ("estimator='1'", "layer=observations", "layer=innovations", "layer=ellipses"):
        toggle = browser.find_element("css selector", f"[data-{button}]")
        toggle.click()
        assert picture() != shown, button
        assert ("ekf" in now.text) == button.startswith("layer")
        toggle.click()
        assert picture() == shown, button
    assert browser.get_log("browser") == []


@pytest.mark.browser
def test_a_page_can_be_downloaded_as_csv_and_read_without_javascript(browser: webdriver.Chrome, page_of: PageOf):
    show(browser, page_of("ranges"))
    scores, series = browser.execute_async_script(
        """const done = arguments[arguments.length - 1], taken = [];
        URL.createObjectURL = (blob) => (taken.push(blob.text()), '#');
        document.querySelector('[data-csv=scores]').click(); document.getElementById('series-csv').click();
        Promise.all(taken).then((texts) => done(texts.map((text) => text.trim().split('\\n'))));"""
    )
    assert scores[0].startswith("estimator,kind,ATE [m],")
    assert {line.split(",")[0] for line in scores[1:]} >= {"ekf", '"own ""<b>&amp;"'}
    assert len(series) == 1 + 301 and series[0].startswith("step,time_s,dead-reckoning x_m,")
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    show(browser, page_of("ranges"))
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert not browser.find_element("id", "replay").is_displayed()
    assert len(browser.find_elements("css selector", "#scores tbody tr")) == 4
