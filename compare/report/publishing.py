"""Write the pages of results into their folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from slamgauge.compare.report.exercise import question_page
from slamgauge.compare.report.grade_page import grade_pages
from slamgauge.compare.report.run_page import run_page
from slamgauge.compare.report.study_page import study_page
from slamgauge.compare.report.table_pages import budget_page, claims_page, noise_page, studies_of, sweep_page
from slamgauge.compare.storage.files import explained, of_this_version, read_json
from slamgauge.compare.storage.manifest import require_free
from slamgauge.compare.storage.result_files import BUDGET, CLAIMS, GRADES, METRICS, NOISE, REPORT, SUMMARY, SWEEP
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError

REMEDY = "move it away"
Pages = Callable[[Path], dict[str, str]]  # from a folder to HTML texts by file name
# pages of results, by main file
PAGES: dict[str, Pages] = {
    METRICS: run_page,
    SUMMARY: study_page,
    SWEEP: sweep_page,
    BUDGET: budget_page,
    CLAIMS: claims_page,
    GRADES: grade_pages,
    NOISE: noise_page,
}


def publish_report(folder: Path) -> None:
    """Write the page of the results in a folder; for a sweep also the pages of its values.

    Raises:
        UserError: If the folder has no results, or slamgauge did not write an existing page.
    """
    require_free(folder, [REPORT], REMEDY)
    latest = latest_in(folder)
    with of_this_version(latest):
        pages = PAGES[latest.name](folder)
        below = studies_of(folder, read_json(latest, "study --sweep")) if latest.name == SWEEP else {}
    for study in below.values():
        publish_report(study)
    _publish(folder, pages)


def publish_question(folder: Path, name: str) -> None:
    """Write the page of a question of the exercise into the folder above the runs of its scenarios.

    Raises:
        UserError: If a run is missing, or slamgauge did not write an existing page.
    """
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


def latest_in(folder: Path) -> Path:
    """Return the main file of the latest results in a folder; raise `UserError` if the folder has no results."""
    found = [folder / name for name in PAGES if (folder / name).is_file()]
    if not found:
        raise UserError(
            f"{folder}: contains no results; give a folder that slamgauge has written ({', '.join(PAGES)}), or q1 to q4"
        )
    return max(found, key=lambda path: path.stat().st_mtime_ns)
