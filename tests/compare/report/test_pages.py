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

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait

from slamgauge import compare_estimators, load_estimators, load_scenario, simulate
from slamgauge.compare.figures.publishing import draw_stored
from slamgauge.compare.report.page import (
    ASSETS,
    MODULES,
    Page,
    Section,
    json_text,
    pack,
    pages_of,
    program,
    render,
    write_pages,
)
from slamgauge.compare.report.run_pages import closure_table
from slamgauge.compare.report.study_pages import command_of_run
from slamgauge.compare.scoring.comparison import metrics, write_comparison
from slamgauge.compare.scoring.table import Cell, Head, Table
from slamgauge.compare.storage.staged_folder import begin_folder
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.summary import Request, Summary
from slamgauge.errors import UserError
from tests.reference.result_folders import SCRIPT_NAME, WRITE

pytestmark = pytest.mark.slow

PageOf = Callable[[str], Path]
USER_NAME = 'own "<b>&amp;'
# main files of the kinds of results; the page of the exercise is written with its results
KINDS = {
    "run": "metrics.json",
    "study": "summary.json",
    "sweep": "sweep.json",
    "budget": "budget.json",
    "noise": "noise.json",
    "grades": "grades.csv",
    "exercise": "",
}
BARE = re.compile(r"^(?:export )?(?:async )?(?:function|class|const|let) +(\w+)", re.MULTILINE)
SOURCES = {name: (ASSETS / "modules" / f"{name}.js").read_text(encoding="utf-8") for name in MODULES}
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


def write_run(folder: Path) -> None:
    """Write a run with a name that contains markup."""
    truth, recording = simulate(load_scenario("q1-long-dense", ["start=mean"]), 0)
    estimators = load_estimators(["dead-reckoning", "ekf", "riekf", "causal", "batch"], frames=240)
    named = {USER_NAME if name == "riekf" else name: each for name, each in estimators.items()}
    comparison = compare_estimators(truth, recording, named)
    begin_folder(folder)
    write_comparison(folder, comparison, metrics(comparison, SCRIPT_NAME, 0))
    assert draw_stored(folder, "metrics.json")


@pytest.fixture(scope="module")
def page_of(tmp_path_factory: pytest.TempPathFactory) -> PageOf:
    """A function that returns the page of a kind of results, which is made once."""
    parent = tmp_path_factory.mktemp("pages")

    def page(kind: str) -> Path:
        folder = parent / kind
        if not folder.exists():
            (write_run if kind == "run" else WRITE[kind])(folder)
            if KINDS[kind]:
                write_pages(folder, pages_of(folder / KINDS[kind]))
        return folder / "report.html"

    return page


# --- HTML ------------------------------------------------------------------------------------------


def test_a_page_has_at_most_three_megabytes_escapes_names_and_allows_only_its_own_script_and_style(page_of: PageOf):
    assert page_of("run").stat().st_size <= 3_000_000
    text = page_of("run").read_text(encoding="utf-8")
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


def test_columns_are_explained_once_and_only_for_tables_with_rows():
    found, left = Head("found", help="the likeliest value"), Head("left", help="what is not shown")
    tables = [Table([found], [[Cell("1")]], "A"), Table([found], [[Cell("1")]], "B"), Table([left], [], "C")]
    text = render(Page("k", "t", [], [], sections=[Section("a section", tables=tables), Section("an empty one")]))
    assert "<h2>a section</h2>" in text and "an empty one" not in text
    assert text.count("<dd>the likeliest value</dd>") == 1 and "what is not shown" not in text


def test_modules_have_distinct_names_and_import_earlier_modules_and_the_script_evaluates_nothing():
    assert {path.name for path in (ASSETS / "modules").iterdir()} == {f"{name}.js" for name in MODULES}
    names = [name for source in SOURCES.values() for name in BARE.findall(source)]
    assert len(names) == len(set(names))
    for place, source in enumerate(SOURCES.values()):
        for imported, other in re.findall(r'^import \{ (.*) \} from "\./(\w+)\.js";$', source, re.MULTILINE):
            assert other in MODULES[:place]
            exported = set(re.findall(r"^export (?:function|class|const) (\w+)", SOURCES[other], re.MULTILINE))
            assert {*imported.split(", ")} <= exported
    forbidden = (
        r"\beval\b|new Function|innerHTML|insertAdjacentHTML|document\.write|fetch\(|https?:|^(?:import|export) .*"
    )
    assert not re.findall(forbidden, program(), re.MULTILINE)


def test_typescript_finds_no_error_in_the_modules():
    words = [installed("node-typescript", "tsc"), "-p", "jsconfig.json", "--noEmit", "--listFiles"]
    found = subprocess.run(words, cwd=str(ASSETS), capture_output=True, text=True, check=False).stdout.splitlines()
    assert {Path(line).stem for line in found if line.endswith(".js")} == set(MODULES)
    assert [line for line in found if not line.endswith((".js", ".d.ts"))] == []


def test_text_has_the_contrast_of_wcag_in_both_schemes():
    def light(colour: str) -> float:
        shares = (int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5))
        r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shares)
        return 0.2126 * r + 0.7152 * g + 0.0722 * b

    schemes = re.findall(r":root \{(.*?)\}", (ASSETS / "page.css").read_text(encoding="utf-8"), re.DOTALL)[:2]
    for scheme in schemes:
        found = dict(re.findall(r"--([\w-]+): (#\w{6})", scheme))
        for text, ground in (
            *itertools.product(("ink", "soft", "accent"), ("paper", "card")),
            ("accent-ink", "accent"),
        ):
            dark, bright = sorted((light(found[text]), light(found[ground])))
            assert (bright + 0.05) / (dark + 0.05) >= 4.5, (text, ground)


def test_a_table_of_very_many_loop_closures_is_thinned_out():
    keys = ("error_before_m", "error_after_m", "sigma_before_m", "sigma_after_m")
    closures = [{"step": step, **dict.fromkeys(keys, 0.1)} for step in range(10_000)]
    table = closure_table({"estimators": {"ekf": {"loop_closure": closures}, "batch": {"loop_closure": None}}})
    assert len(table.rows) == 500 and "1 in 20 loop closures" in table.caption


def test_the_command_of_a_run_has_the_settings_of_the_study():
    request = Request("my map.toml", ("a.b=1", "c=[1, 2]"), "ekf,mine.py:f", "association.gate=4")
    summary = Summary("my map", 9, 0, "", (), {}, request=request)
    expected = "'my map.toml' --seed 7 --set a.b=1 'c=[1, 2]' association.gate=4 --estimators ekf,mine.py:f"
    assert command_of_run(summary, 7) == f"slamgauge run {expected}"
    assert "add the --set options of the study" in command_of_run(replace(summary, request=None), 7)


def test_a_page_of_other_results_is_refused(page_of: PageOf, tmp_path: Path):
    study, value = page_of("study").parent, page_of("sweep").parent / "assumed.scale=2"
    shutil.copy(study / "study.sqlite", tmp_path)
    summary = json.loads((study / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps({**summary, "digest": "0" * 64}))
    with pytest.raises(UserError, match="has another study than the summary in this folder"):
        pages_of(tmp_path / "summary.json")
    assert [*load_study(value).runs] == ["ekf", "causal"]  # the optimum is stored beside the value
    for name in ("summary.json", "study.sqlite"):
        shutil.copy(value / name, tmp_path)
    with pytest.raises(UserError, match="has no run of causal; give the command of the study again"):
        load_study(tmp_path)


# --- in a browser ----------------------------------------------------------------------------------


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
        patterns = ('<th scope="col"[^>]*>(.*?)</th>', "<dt>(.*?)</dt><dd>")
        titles, terms = ({html.unescape(found) for found in re.findall(pattern, text)} for pattern in patterns)
        assert titles - terms <= ({"ekf", "causal", "batch"} if kind == "study" else set())  # columns of estimators


@pytest.mark.parametrize(
    ("kind", "link", "title"),
    [
        ("sweep", "#sweep tbody tr:nth-child(3) a, #sweep tbody tr:nth-child(2) a", "q1-short-dense at assumed.scale="),
        ("grades", "#grades a", 'a "<b>: FAILED, 47 of 100 points'),
        ("exercise", "h3 + p a", "q3-scale-0.1, seed "),
    ],
)
def test_pages_link_to_the_pages_of_values_submissions_and_replays(
    browser: webdriver.Chrome, page_of: PageOf, kind: str, link: str, title: str
):
    show(browser, page_of(kind))
    browser.find_element("css selector", link).click()
    assert title in browser.find_element("tag name", "h1").text


def test_a_run_is_replayed(browser: webdriver.Chrome, page_of: PageOf):
    show(browser, page_of("run"))
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
    browser.execute_script(SCRUB, 900)
    assert paused < frame() == 900 and now.text.startswith("t = 90 s, step 900: ekf 0.433 m")
    for canvas in ("error-panel", "nees-panel", "nis-panel", "timeline"):
        browser.execute_script(SCRUB, 0)
        browser.find_element("id", canvas).click()
        assert (canvas, frame()) == (canvas, pytest.approx(0.5 * 1257, abs=60))
    for key, expected in ((Keys.HOME, 0), (Keys.ARROW_RIGHT, 1), (Keys.END, 1257), (Keys.ARROW_LEFT, 1256)):
        browser.find_element("tag name", "body").send_keys(key)
        assert frame() == expected
    browser.execute_script(SCRUB, 600)
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


def test_a_page_can_be_downloaded_as_csv_printed_and_read_without_javascript(
    browser: webdriver.Chrome, page_of: PageOf
):
    show(browser, page_of("run"))
    scores, series = browser.execute_async_script(
        """const done = arguments[arguments.length - 1], taken = [];
        URL.createObjectURL = (blob) => (taken.push(blob.text()), '#');
        document.querySelector('[data-csv=scores]').click(); document.getElementById('series-csv').click();
        Promise.all(taken).then((texts) => done(texts.map((text) => text.trim().split('\\n'))));"""
    )
    assert scores[0].startswith("estimator,kind,ATE [m],")
    assert {line.split(",")[0] for line in scores[1:]} >= {"ekf", '"own ""<b>&amp;"'}
    assert len(series) == 1 + 1258 and series[0].startswith("step,time_s,dead-reckoning x_m,")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    show(browser, page_of("run"), width=718)  # A4 with margins of a centimetre
    assert browser.find_element("id", "replay").size["height"] == 0
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 718
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    show(browser, page_of("run"))
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert not browser.find_element("id", "replay").is_displayed()
    assert len(browser.find_elements("css selector", "#scores tbody tr")) == 5
