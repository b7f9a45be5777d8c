"""Write the pages of results into their folders."""

from __future__ import annotations

import importlib
from pathlib import Path

from slamgauge.compare.storage.files import explained, of_this_version, read_json
from slamgauge.compare.storage.manifest import require_free
from slamgauge.compare.storage.result_files import BUDGET, CLAIMS, GRADES, METRICS, NOISE, REPORT, SUMMARY, SWEEP
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError

REMEDY = "move it away"
# function that makes the pages of results from their folder, as texts by file name, for each main file; it is imported
# when it is needed, because the libraries of some are slow to start
PAGES = {
    METRICS: "run_page:run_page",
    SUMMARY: "study_page:study_page",
    SWEEP: "table_pages:sweep_page",
    BUDGET: "table_pages:budget_page",
    CLAIMS: "table_pages:claims_page",
    GRADES: "grade_page:grade_pages",
    NOISE: "table_pages:noise_page",
}


def publish_report(folder: Path) -> None:
    """Write the page of the results in a folder; for a sweep also the pages of its values.

    Raises:
        UserError: If the folder has no results, or slamgauge did not write an existing page.
    """
    require_free(folder, [REPORT], REMEDY)
    latest = latest_in(folder)
    with of_this_version(latest):
        pages, below = pages_of(latest), _studies_below(latest)
    for study in below:
        publish_report(study)
    _publish(folder, pages)


def _studies_below(main: Path) -> list[Path]:
    """Return the folders of the values of a sweep; none for other results."""
    if main.name != SWEEP:
        return []
    from slamgauge.compare.report.table_pages import studies_of

    return [*studies_of(main.parent, read_json(main, "study --sweep")).values()]


def publish_question(folder: Path, name: str) -> None:
    """Write the page of a question of the exercise into the folder above the runs of its scenarios.

    Raises:
        UserError: If a run is missing, or slamgauge did not write an existing page.
    """
    from slamgauge.compare.report.exercise import question_page

    require_free(folder, [REPORT], REMEDY)
    _publish(folder, {REPORT: question_page(folder, name)})


def _publish(folder: Path, pages: dict[str, str]) -> None:
    with staged_folder(folder, pages, last=REPORT, remedy=REMEDY) as stage, explained(folder, "written"):
        write_pages(stage, pages)


def write_pages(stage: Path, pages: dict[str, str]) -> None:
    """Write pages, HTML texts by name, into the folder `stage`."""
    for name, text in pages.items():
        (stage / name).parent.mkdir(exist_ok=True)
        (stage / name).write_text(text, encoding="utf-8", newline="\n")


def pages_of(main: Path) -> dict[str, str]:
    """Return the pages of results, HTML texts by file name; `main` is their main file."""
    module, _, name = PAGES[main.name].partition(":")
    return getattr(importlib.import_module(f"slamgauge.compare.report.{module}"), name)(main.parent)


def latest_in(folder: Path) -> Path:
    """Return the main file of the latest results in a folder; raise `UserError` if the folder has no results."""
    found = [folder / name for name in PAGES if (folder / name).is_file()]
    if not found:
        raise UserError(
            f"{folder}: contains no results; give a folder that slamgauge has written ({', '.join(PAGES)}), or q1 to q4"
        )
    return max(found, key=lambda path: path.stat().st_mtime_ns)
