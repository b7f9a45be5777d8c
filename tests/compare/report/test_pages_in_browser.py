"""A page of each kind in a real browser, opened from disk; and the replay of a run."""

from __future__ import annotations

import base64
import html
import itertools
import re
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from tests.reference.result_folders import SCRIPT_NAME

from .conftest import KINDS, Reader

pytestmark = pytest.mark.slow

PageOf = Callable[[str], Path]
SCRUB = """const scrub = document.getElementById('scrub');
scrub.value = arguments[0]; scrub.dispatchEvent(new Event('input'));"""
FRAME = "return Number(document.getElementById('scrub').value)"
TEXT = "return document.getElementById(arguments[0]).textContent"
PICTURE = "return document.getElementById(arguments[0]).toDataURL()"
KEY = """const key = {key: arguments[1], bubbles: true, cancelable: true};
(document.getElementById(arguments[0]) ?? document.body).dispatchEvent(new KeyboardEvent('keydown', key));"""
CLICK = """const canvas = document.getElementById(arguments[0]), box = canvas.getBoundingClientRect();
const at = {clientX: box.left + arguments[1] * box.width, clientY: box.top + 50, bubbles: true, pointerId: 1};
canvas.setPointerCapture = () => {};
canvas.dispatchEvent(new PointerEvent('pointerdown', at));"""
LATER = "const done = arguments[arguments.length - 1]; setTimeout(done, 300);"
PLAYED = """const done = arguments[arguments.length - 1], scrub = document.getElementById('scrub');
const look = () => Number(scrub.value) > 10 ? done(true) : setTimeout(look, 50);
look();"""
NAMELESS = """return [...document.querySelectorAll('button, select, input, canvas, img, [role=region]')]
.filter((each) => !(each.textContent.trim() || each.getAttribute('aria-label') || each.alt || each.labels?.length))
.map((each) => each.outerHTML)"""
SMALL = """document.querySelectorAll('details').forEach((each) => { each.open = true; });
return [...document.querySelectorAll('button, select, input, summary')].filter((each) => {
  const { width, height } = each.getBoundingClientRect(); return width < 24 || height < 24; })
.map((each) => each.outerHTML)"""
POOR = """
const light = (text) => { const [r, g, b] = text.match(/[\\d.]+/g).slice(0, 3).map(Number).map((c) => c / 255)
  .map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const ground = (each) => { for (; each; each = each.parentElement) { const c = getComputedStyle(each).backgroundColor;
  if (!/rgba\\(.*, 0\\)/.test(c)) return c; } return 'rgb(255, 255, 255)'; };
const poor = [];
for (const each of document.querySelectorAll('body *')) {
  const hasText = [...each.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  if (!hasText || !each.offsetParent) continue;
  const pair = [light(getComputedStyle(each).color), light(ground(each))].sort((a, b) => b - a);
  if ((pair[0] + 0.05) / (pair[1] + 0.05) < 4.5) poor.push(each.outerHTML.slice(0, 120));
}
return poor;"""


@pytest.fixture
def opened(reader: Reader, run_page: Path) -> Generator[Reader]:
    reader.open(run_page)
    yield reader
    assert reader.complaints() == []


@pytest.mark.parametrize("kind", ["run", *KINDS])
def test_a_page_of_each_kind_is_right(reader: Reader, page_of: PageOf, kind: str):
    """Nothing else is loaded, columns are explained, and WCAG 2.2 holds: contrast 1.4.3, size of targets 2.5.8."""
    page = page_of(kind)
    for each in {page, *page.parent.glob("submissions/*.html")}:
        reader.requests()
        reader.open(each)
        assert reader.requests() == [each.as_uri()]
        assert reader.run("return document.querySelectorAll('script').length") == 2
        assert reader.run("return document.querySelectorAll('h1').length") == 1
        levels = reader.run("return [...document.querySelectorAll('h1, h2, h3')].map((each) => +each.tagName[1])")
        assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
        assert reader.run(POOR) == []
        assert reader.run(NAMELESS) == []
        assert reader.run(SMALL) == []
        reader.open(each, width=360, dark=True)
        assert reader.run(POOR) == []
        assert reader.run("return document.documentElement.scrollWidth") <= 360
        assert reader.complaints() == []
        text = each.read_text(encoding="utf-8")
        patterns = ('<th scope="col"[^>]*>(.*?)</th>', "<dt>(.*?)</dt><dd>")
        heads, terms = ({html.unescape(found) for found in re.findall(pattern, text)} for pattern in patterns)
        assert heads - terms <= ({"ekf", "causal", "batch"} if kind == "study" else set())  # columns of estimators


@pytest.mark.parametrize("kind", ["run", *KINDS])
def test_a_table_sorts_by_each_column(reader: Reader, page_of: PageOf, kind: str):
    reader.open(page_of(kind))
    for column in range(reader.run("return document.querySelector('table').tHead.rows[0].cells.length")):
        for order in ("ascending", "descending"):
            reader.run(
                "document.querySelectorAll('table')[0].querySelectorAll('thead button')[arguments[0]].click()", column
            )
            found = reader.run("return document.querySelector('table th[aria-sort]').getAttribute('aria-sort')")
            values = reader.run(
                "return [...document.querySelector('table').tBodies[0].rows]"
                ".map((row) => row.cells[arguments[0]].dataset.value ?? null)",
                column,
            )
            known = [float(value) for value in values if value is not None]
            assert (found, known) == (order, sorted(known, reverse=order == "descending"))
            assert None not in values[: len(known)] or not known  # cells without a number come last
    assert reader.complaints() == []


# --- the replay of a run -----------------------------------------------------------------------


def test_play_moves_the_robot_until_it_is_paused(opened: Reader):
    before = opened.run(PICTURE, "map-canvas")
    opened.run("document.getElementById('play').click()")
    assert opened.run(TEXT, "play") == "Pause"
    assert opened.wait(PLAYED)
    opened.run("document.getElementById('play').click()")
    frame = opened.run(FRAME)
    assert opened.run(PICTURE, "map-canvas") != before
    opened.wait(LATER)
    assert opened.run(FRAME) == frame


def test_scrubbing_and_clicks_show_that_moment(opened: Reader):
    assert opened.run(TEXT, "now").startswith("t = 0 s, step 0: ekf 0 m, ")
    opened.run(SCRUB, 900)
    assert opened.run(TEXT, "now").startswith("t = 90 s, step 900: ekf 0.433 m")
    for canvas in ("error-panel", "nees-panel", "nis-panel", "timeline"):
        opened.run(SCRUB, 0)
        opened.run(CLICK.replace("box.top + 50", "box.top + box.height / 2"), canvas, 0.5)
        assert (canvas, opened.run(FRAME)) == (canvas, pytest.approx(0.5 * 1257, abs=60))


def test_estimators_and_layers_are_hidden_and_shown(opened: Reader):
    opened.run(SCRUB, 600)
    shown = opened.run(PICTURE, "map-canvas")
    for button in ("estimator='1'", "layer=observations", "layer=innovations", "layer=ellipses"):
        click = f'document.querySelector("[data-{button}]").click()'
        opened.run(click)
        assert opened.run(PICTURE, "map-canvas") != shown, button
        assert ("ekf" in opened.run(TEXT, "now")) == button.startswith("layer")
        opened.run(click)
        assert opened.run(PICTURE, "map-canvas") == shown, button


def test_keys_step_follow_zoom_and_toggle(opened: Reader):
    for key, frame in (("ArrowRight", 1), ("End", 1257), ("ArrowLeft", 1256), ("Home", 0)):
        opened.run(KEY, "", key)
        assert opened.run(FRAME) == frame
    whole = opened.run(PICTURE, "map-canvas")
    opened.run(KEY, "", "f")
    followed = opened.run(PICTURE, "map-canvas")
    assert followed != whole
    opened.run(KEY, "", "+")
    assert opened.run(PICTURE, "map-canvas") != followed
    opened.run(KEY, "", "0")
    assert opened.run(PICTURE, "map-canvas") == whole
    opened.run(KEY, "", "2")
    assert opened.run("return document.querySelectorAll('.toggle')[1].getAttribute('aria-pressed')") == "false"


def test_data_can_be_downloaded_as_csv(opened: Reader):
    opened.run(
        """window.taken = []; URL.createObjectURL = (blob) => (blob.text().then((text) => taken.push(text)), '#');
        document.querySelector('[data-csv=scores]').click(); document.getElementById('series-csv').click();"""
    )
    opened.wait(LATER)
    scores, series = (text.splitlines() for text in opened.run("return taken"))
    assert scores[0].startswith("estimator,kind,ATE [m],")
    assert {line.split(",")[0] for line in scores[1:]} >= {"ekf", '"own ""<b>&amp;"'}
    assert len(series) == 1 + 1258
    assert series[0].startswith("step,time_s,dead-reckoning x_m,")


def test_a_page_can_be_printed_and_read_without_javascript(reader: Reader, run_page: Path):
    reader.open(run_page)
    printed = reader.command("Page.printToPDF", printBackground=True)
    assert base64.b64decode(printed["data"]).startswith(b"%PDF-")
    reader.command("Emulation.setEmulatedMedia", media="print")
    reader.command("Emulation.setDeviceMetricsOverride", width=718, height=1000, deviceScaleFactor=1, mobile=False)
    assert reader.run("return document.getElementById('replay').clientHeight") == 0
    assert reader.run("return document.querySelector('figure img').clientHeight") > 100
    assert reader.run("return document.documentElement.scrollWidth") <= 718  # A4 with margins of a centimetre
    reader.command("Emulation.setScriptExecutionDisabled", value=True)
    try:
        reader.open(run_page)
        reader.command("Emulation.setScriptExecutionDisabled", value=False)
        assert reader.run("return document.getElementById('replay').hidden") is True
        assert reader.run("return document.querySelectorAll('#scores tbody tr').length") == 5
    finally:
        reader.command("Emulation.setScriptExecutionDisabled", value=False)


# --- sweeps, grades and the exercise ----------------------------------------------------------------


def test_pages_link_to_the_pages_of_values_submissions_and_replays(reader: Reader, page_of: PageOf):
    for kind, link, title in (
        ("sweep", "#sweep tbody tr:nth-child(3) a, #sweep tbody tr:nth-child(2) a", "q1-short-dense at assumed.scale="),
        ("grades", "#grades a", 'a "<b>: FAILED'),
        ("exercise", "h3 + p a", "q3-scale-0.1, seed "),
    ):
        reader.open(page_of(kind))
        reader.run("document.querySelector(arguments[0]).click()", link)
        assert title in reader.run("return document.querySelector('h1').textContent")
    reader.open(page_of("grades"))
    assert SCRIPT_NAME in reader.run("return document.body.textContent")
    assert "the wrapping of the heading" in reader.run("return document.querySelector('#checks tbody').textContent")
