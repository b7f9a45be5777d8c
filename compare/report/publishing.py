"""Pages written beside the results that they explain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from slamgauge.compare.report.budget_page import budget_page
from slamgauge.compare.report.claims_page import claims_page
from slamgauge.compare.report.grade_page import grade_pages
from slamgauge.compare.report.noise_page import noise_page
from slamgauge.compare.report.practical import question_page
from slamgauge.compare.report.run_page import run_page
from slamgauge.compare.report.study_page import study_page
from slamgauge.compare.report.sweep_page import sweep_page
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.manifest import require_free
from slamgauge.compare.storage.result_files import BUDGET, CLAIMS, GRADES, METRICS, NOISE, REPORT, SUMMARY, SWEEP
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError

REMEDY = "move it away"
Pages = Callable[[Path], dict[str, str]]  # of a folder: texts by the names of their files
# by the file that tells of such results
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
    """Write the page of the results in a folder beside them, whole or not at all.

    Raises:
        UserError: there are no results, or a page that is not ours is in the way.
    """
    require_free(folder, [REPORT], REMEDY)
    _publish(folder, pages_of(folder))


def publish_question(folder: Path, name: str) -> None:
    """Write the page of a question of the practical above the runs of its scenarios.

    Raises:
        UserError: a run is missing, or a page that is not ours is in the way.
    """
    require_free(folder, [REPORT], REMEDY)
    _publish(folder, {REPORT: question_page(folder, name)})


def write_pages(stage: Path, folder: Path, beside: str) -> None:
    """Write the pages of the results in `folder` that the file `beside` there tells of into the folder `stage`."""
    _write(stage, PAGES[beside](folder))


def _publish(folder: Path, pages: dict[str, str]) -> None:
    with staged_folder(folder, pages, last=REPORT, remedy=REMEDY) as stage, explained(folder, "written"):
        _write(stage, pages)


def _write(stage: Path, pages: dict[str, str]) -> None:
    for name, text in pages.items():
        (stage / name).parent.mkdir(exist_ok=True)
        (stage / name).write_text(text, encoding="utf-8", newline="\n")


def pages_of(folder: Path) -> dict[str, str]:
    """The pages that explain what lies in a folder, by the names of their files; of several results the latest.

    Raises:
        UserError: nothing of ours does, or it does not belong together.
    """
    found = [folder / name for name in PAGES if (folder / name).is_file()]
    if found:
        latest = max(found, key=lambda path: path.stat().st_mtime_ns)
        try:
            return PAGES[latest.name](folder)
        except (LookupError, TypeError, AttributeError):  # what it tells is not what this version writes
            raise UserError(f"{latest}: of another version, or changed by hand; give its command again") from None
    raise UserError(
        f"{folder}: holds no results; give a folder that slamgauge has written ({', '.join(PAGES)}), or q1 to q4"
    )
