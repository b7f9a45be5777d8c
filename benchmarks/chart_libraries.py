"""Which charting library fits into a page: bytes of its program, complaints under the pages' policy, time to start.

    pip install bokeh plotly
    python benchmarks/chart_libraries.py

Five curves of a thousand points each, on a page of one file that opens from disk under a Content-Security-Policy that
names its program by its digest. Libraries that are not installed, and times where there is no browser, are "-".
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.compare.report.page import policy, program
from slamgauge.compare.scoring.text_table import aligned

TIME = np.linspace(0.0, 100.0, 1000)
CURVES = [np.sin(TIME + phase).tolist() for phase in range(5)]


class Chart(NamedTuple):
    """A library's program, what makes it draw, and where it draws."""

    library: str
    start: str
    place: str


def bokeh() -> Chart:
    embed, plotting = (importlib.import_module(f"bokeh.{name}") for name in ("embed", "plotting"))
    figure = plotting.figure(width=600, height=300)
    for curve in CURVES:
        figure.line(TIME, curve)
    start, place = embed.components(figure)
    return Chart(shipped("bokeh", "server/static/js/bokeh.min.js"), re.sub(r"</?script[^>]*>", "", start), place)


def plotly() -> Chart:
    curves = [{"x": TIME.tolist(), "y": curve} for curve in CURVES]
    library = shipped("plotly", "package_data/plotly.min.js")
    return Chart(library, f"Plotly.newPlot('chart', {json.dumps(curves)});", "<div id='chart'></div>")


def slamgauge() -> Chart:
    """The charts of our own pages, with all that moves there."""
    series = [{"color": "#0077bb", "dashes": [], "values": curve, "shown": True} for curve in CURVES]
    chart = json.dumps({"title": "", "times": TIME.tolist(), "series": series})
    start = f"new Panel(document.getElementById('chart'), {chart}, () => 0).draw();"
    return Chart(program().replace(page_start(), ""), start, "<canvas id='chart'></canvas>")


def page_start() -> str:
    """What our program does when a page of results opens."""
    return program()[program().index("const data = JSON.parse") :]


def shipped(package: str, name: str) -> str:
    found = importlib.util.find_spec(package)
    assert found is not None
    assert found.origin is not None
    return (Path(found.origin).parent / name).read_text(encoding="utf-8")


def measure(chart: Chart, folder: Path) -> list[str]:
    """Complaints of the browser, and milliseconds until the page is there: the least of three times."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    script = f"{chart.library}\n{chart.start}"
    head = f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy("", script)}">'
    page = folder / "page.html"
    page.write_text(f"<!doctype html><head>{head}</head><body>{chart.place}<script>{script}</script></body>", "utf-8")
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    times, complaints = list[float](), 0
    for _ in range(3):
        driver.get(page.as_uri())
        time.sleep(1.0)  # what draws later complains later
        complaints = len(driver.get_log("browser"))
        begin = "return performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd"
        times.append(float(driver.execute_script(begin)))
    driver.quit()
    return [str(complaints), f"{min(times):.0f}"]


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    libraries: dict[str, Callable[[], Chart]] = {"slamgauge": slamgauge, "bokeh": bokeh, "plotly": plotly}
    has_browser = shutil.which("chromium") and shutil.which("chromedriver")
    rows: list[list[Any]] = [["library", "bytes", "complaints", "start [ms]"]]
    with tempfile.TemporaryDirectory() as folder:
        for name, make in libraries.items():
            if importlib.util.find_spec(name) is None:
                rows.append([name, "-", "-", "-"])
                continue
            chart = make()
            found = measure(chart, Path(folder)) if has_browser else ["-", "-"]
            rows.append([name, str(len(chart.library.encode())), *found])
    print("\n".join(aligned(rows, words=1)))


if __name__ == "__main__":
    main()
