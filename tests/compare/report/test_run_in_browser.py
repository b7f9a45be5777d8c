"""The page of a run in a real browser, opened from disk."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Generator
from pathlib import Path

import pytest

from .conftest import Reader

pytestmark = pytest.mark.slow

SCRUB = """const scrub = document.getElementById('scrub');
scrub.value = arguments[0]; scrub.dispatchEvent(new Event('input'));"""
FRAME = "return Number(document.getElementById('scrub').value)"
NOW = "return document.getElementById('now').textContent"
PIXELS = """const canvas = document.getElementById(arguments[0]), copy = document.createElement('canvas');
[copy.width, copy.height] = [canvas.width, canvas.height];
const pen = copy.getContext('2d', {willReadFrequently: true});
pen.drawImage(canvas, 0, 0);
const {data} = pen.getImageData(0, 0, copy.width, copy.height);
let sum = 0; for (let k = 0; k < data.length; k += 4) if (data[k + 3]) sum += (k % 9973) + data[k] + 3 * data[k + 1];
return sum;"""
KEY = """const key = {key: arguments[0], bubbles: true, cancelable: true};
document.body.dispatchEvent(new KeyboardEvent('keydown', key));"""
CLICK = """const canvas = document.getElementById(arguments[0]), box = canvas.getBoundingClientRect();
const [clientX, clientY] = [box.left + arguments[1] * box.width, box.top + box.height / 2];
const at = {clientX, clientY, bubbles: true, pointerId: 1};
canvas.setPointerCapture = () => {};
canvas.dispatchEvent(new PointerEvent('pointerdown', at));"""
FRAMES_IN_A_SECOND = """const done = arguments[arguments.length - 1]; let count = 0, start = performance.now();
const next = (now) => { count++;
  now - start < 1000 ? requestAnimationFrame(next) : done(count * 1000 / (now - start)); };
requestAnimationFrame(next);"""


@pytest.fixture
def opened(reader: Reader, run_page: Path) -> Generator[Reader]:
    reader.requests()
    reader.open(run_page)
    yield reader
    assert reader.complaints() == []


def test_the_page_loads_nothing_else(opened: Reader, run_page: Path):
    assert opened.requests() == [run_page.as_uri()]
    assert opened.run("return document.querySelectorAll('script[src], link, iframe').length") == 0


def test_the_page_loads_within_a_second(reader: Reader, run_page: Path):
    """One of three times, because other programs use the machine."""

    def loading_time() -> float:
        reader.open(run_page)
        return reader.run("return performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd")

    assert any(loading_time() < 1000 for _ in range(3))


def test_play_moves_the_robot_until_it_is_paused(opened: Reader):
    before = opened.run(PIXELS, "map-canvas")
    opened.run("document.getElementById('play').click()")
    assert opened.run("return document.getElementById('play').textContent") == "Pause"
    opened.wait(FRAMES_IN_A_SECOND)
    opened.run("document.getElementById('play').click()")
    frame = opened.run(FRAME)
    assert frame > 10
    assert opened.run(PIXELS, "map-canvas") != before
    opened.wait(FRAMES_IN_A_SECOND)
    assert opened.run(FRAME) == frame


def test_twenty_frames_a_second_with_five_estimators(opened: Reader):
    """In one of three seconds, because other programs use the machine."""
    opened.run("document.querySelector('.toggle[aria-pressed=false]').click()")
    assert opened.run("return document.querySelectorAll('.toggle[aria-pressed=true]').length") == 5
    opened.run(SCRUB, 700)
    opened.run("document.getElementById('play').click()")
    assert any(opened.wait(FRAMES_IN_A_SECOND) >= 20 for _ in range(3))


def test_scrubbing_shows_that_moment_and_rounding_errors_as_zero(opened: Reader):
    assert opened.run(NOW).startswith("t = 0 s, step 0: ekf 0 m, ")
    assert "e-" not in opened.run(NOW)
    opened.run(SCRUB, 900)
    assert opened.run(NOW).startswith("t = 90 s, step 900: ekf 0.433 m")


def test_a_click_in_a_panel_or_on_the_time_line_jumps_there(opened: Reader):
    for canvas in ("error-panel", "nees-panel", "nis-panel", "timeline"):
        opened.run(SCRUB, 0)
        opened.run(CLICK, canvas, 0.5)
        assert (canvas, opened.run(FRAME)) == (canvas, pytest.approx(0.5 * 1257, abs=60))


def test_estimators_and_layers_are_hidden_and_shown(opened: Reader):
    opened.run(SCRUB, 600)
    shown = opened.run(PIXELS, "map-canvas")
    for button in ("estimator='1'", "layer=observations", "layer=innovations", "layer=ellipses"):
        click = f'document.querySelector("[data-{button}]").click()'
        opened.run(click)
        assert opened.run(PIXELS, "map-canvas") != shown, button
        assert ("ekf" in opened.run(NOW)) == button.startswith("layer")
        opened.run(click)
        assert opened.run(PIXELS, "map-canvas") == shown, button


def test_keys_play_step_follow_zoom_and_toggle(opened: Reader):
    for key, frame in (("ArrowRight", 1), ("End", 1257), ("ArrowLeft", 1256), ("Home", 0)):
        opened.run(KEY, key)
        assert opened.run(FRAME) == frame
    opened.run(KEY, " ")
    assert opened.run("return document.getElementById('play').textContent") == "Pause"
    opened.run(KEY, " ")
    whole = opened.run(PIXELS, "map-canvas")
    opened.run(KEY, "f")
    assert opened.run("return document.getElementById('follow').getAttribute('aria-pressed')") == "true"
    followed = opened.run(PIXELS, "map-canvas")
    assert followed != whole
    opened.run(KEY, "+")
    assert opened.run(PIXELS, "map-canvas") != followed
    opened.run(KEY, "0")
    assert opened.run(PIXELS, "map-canvas") == whole
    opened.run(KEY, "2")
    assert opened.run("return document.querySelectorAll('.toggle')[1].getAttribute('aria-pressed')") == "false"


def test_tables_sort_by_figures_and_by_names(opened: Reader):
    order = "return [...document.querySelectorAll('#scores tbody th')].map(each => each.textContent)"
    head = "document.querySelectorAll('#scores thead button')[arguments[0]].click()"
    opened.run(head, 2)
    assert opened.run(order) == ['own "<b>&amp;', "causal", "batch", "ekf", "dead-reckoning"]
    opened.run(head, 2)
    assert opened.run(order)[0] == "dead-reckoning"
    assert (
        opened.run("return document.querySelector('#scores th[aria-sort]').getAttribute('aria-sort')") == "descending"
    )
    opened.run(head, 0)
    assert opened.run(order)[0] == "batch"
    opened.run(head, 8)
    assert opened.run(order)[-1] == "dead-reckoning", "a cell without a number comes last"


def test_data_can_be_downloaded_as_csv(opened: Reader):
    opened.run(
        """window.taken = []; URL.createObjectURL = (blob) => (blob.text().then((text) => taken.push(text)), '#');
        document.querySelector('[data-csv=scores]').click(); document.getElementById('series-csv').click();"""
    )
    opened.wait(FRAMES_IN_A_SECOND)
    scores, series = (text.splitlines() for text in opened.run("return taken"))
    assert scores[0].startswith("estimator,kind,ATE [m],")
    assert {line.split(",")[0] for line in scores[1:]} >= {"ekf", '"own ""<b>&amp;"'}
    assert len(series) == 1 + 1258
    assert series[0].startswith("step,time_s,dead-reckoning x_m,")


def test_a_narrow_screen_shows_everything_without_scrolling_sideways(reader: Reader, run_page: Path):
    reader.open(run_page, width=360)
    assert reader.run("return document.documentElement.scrollWidth") <= 360
    assert reader.run("return document.getElementById('map-canvas').clientWidth") > 300
    assert 300 < reader.run("return document.querySelector('figure img').clientWidth") <= 360
    assert reader.complaints() == []
    ends = reader.run(
        "return [...document.querySelectorAll('.caption')].map((each) => each.getBoundingClientRect().right)"
    )
    assert 0 < max(ends) <= 360


def test_controls_are_large_enough_for_touch(opened: Reader):
    """WCAG 2.2, 2.5.8: at least 24 by 24 pixels."""
    small = opened.run(
        """document.querySelectorAll('details').forEach((each) => { each.open = true; });
        return [...document.querySelectorAll('button, select, input, summary')].filter((each) => {
          const { width, height } = each.getBoundingClientRect(); return width < 24 || height < 24; })
        .map((each) => each.outerHTML)"""
    )
    assert small == []


def test_the_printed_page_has_tables_and_figures_but_no_replay(reader: Reader, run_page: Path):
    reader.open(run_page)
    printed = reader.command("Page.printToPDF", printBackground=True)
    assert base64.b64decode(printed["data"]).startswith(b"%PDF-")
    reader.command("Emulation.setEmulatedMedia", media="print")
    assert reader.run("return document.getElementById('replay').clientHeight") == 0
    assert reader.run("return document.querySelector('figure img').clientHeight") > 100
    reader.command("Emulation.setDeviceMetricsOverride", width=718, height=1000, deviceScaleFactor=1, mobile=False)
    assert reader.run("return document.documentElement.scrollWidth") <= 718  # A4 with margins of a centimetre
    reader.command("Emulation.setEmulatedMedia", media="")


def test_tables_and_figures_do_not_need_javascript(reader: Reader, run_page: Path):
    reader.command("Emulation.setScriptExecutionDisabled", value=True)
    try:
        reader.open(run_page)
        reader.command("Emulation.setScriptExecutionDisabled", value=False)
        assert reader.run("return document.getElementById('replay').hidden") is True
        assert reader.run("return document.querySelectorAll('#scores tbody tr').length") == 5
        assert reader.run("return document.querySelector('figure img').naturalWidth") > 1000
    finally:
        reader.command("Emulation.setScriptExecutionDisabled", value=False)


LUMINANCE = """
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


@pytest.mark.parametrize("dark", [False, True])
def test_every_text_has_enough_contrast(reader: Reader, run_page: Path, dark: bool):
    """WCAG 2.2, 1.4.3: a contrast of at least 4.5."""
    reader.open(run_page, dark=dark)
    assert reader.run(LUMINANCE) == []


def test_controls_and_pictures_have_accessible_names(opened: Reader):
    nameless = opened.run(
        """return [...document.querySelectorAll('button, select, input, canvas, img, [role=region]')].filter((each) =>
        !(each.textContent.trim() || each.getAttribute('aria-label') || each.alt || each.labels?.length))
        .map((each) => each.outerHTML)"""
    )
    assert nameless == []
    assert opened.run("return document.documentElement.lang") == "en"
    assert opened.run("return document.querySelectorAll('h1').length") == 1
    assert opened.run("return document.title") == "<script>alert(1)</script>, seed 0"
    levels = opened.run("return [...document.querySelectorAll('h1, h2, h3')].map((each) => Number(each.tagName[1]))")
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
