"""Write the pages of results into their folders."""

from __future__ import annotations

import importlib
from pathlib import Path

from slamgauge.compare.storage.result_files import BUDGET, GRADES, METRICS, NOISE, SUMMARY, SWEEP

# function that makes the pages of results from their folder, as texts by file name, for each main file; it is imported
# when it is needed, because the libraries of some are slow to start
PAGES = {
    METRICS: "run_page:run_page",
    SUMMARY: "study_page:study_page",
    SWEEP: "table_pages:sweep_page",
    BUDGET: "table_pages:budget_page",
    GRADES: "grade_page:grade_pages",
    NOISE: "table_pages:noise_page",
}


def write_pages(stage: Path, pages: dict[str, str]) -> None:
    """Write pages, HTML texts by name, into the folder `stage`."""
    for name, text in pages.items():
        (stage / name).parent.mkdir(exist_ok=True)
        (stage / name).write_text(text, encoding="utf-8", newline="\n")


def pages_of(main: Path) -> dict[str, str]:
    """Return the pages of results, HTML texts by file name; `main` is their main file."""
    module, _, name = PAGES[main.name].partition(":")
    return getattr(importlib.import_module(f"slamgauge.compare.report.{module}"), name)(main.parent)
