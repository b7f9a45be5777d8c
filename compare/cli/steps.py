"""Steps that several commands share: from options to requests, scenarios, executors, folders and pages."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Generator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from slamgauge.compare.cli.options.shared import OwnCode, PageOptions, WithPage, Work, flattened
from slamgauge.compare.estimators.requests import Asked, Limits, with_limits, with_noise
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.storage.result_files import REPORT
from slamgauge.compare.storage.staged_folder import decorate, staged_folder
from slamgauge.compare.studies.executors import local_processes
from slamgauge.errors import UserError

LONGEST_TIMEOUT = 1e6  # s; `select` counts milliseconds in 31 bits
MOST_JOBS = 1024


def isolated(asked: list[Asked], own_code: OwnCode) -> list[Asked]:
    """Set noise and limits of user code among the requests."""
    limits = Limits(require_timeout(own_code.timeout), own_code.strict and not own_code.unconfined)
    return with_limits(with_noise(asked, own_code.noise), limits, strict=own_code.strict)


def executor_of(work: Work) -> AbstractContextManager[Executor]:
    """Return an executor of worker processes."""
    if not 1 <= work.jobs <= MOST_JOBS:
        raise UserError(f"jobs: {work.jobs} is out of range; give 1 to {MOST_JOBS}")
    return local_processes(work.jobs)


def overridden_scenario(scenario: str, overrides: Sequence[Sequence[str]]) -> Scenario:
    """Load a scenario with the values of --set."""
    return load_scenario(scenario, flattened(overrides))


def require_timeout(seconds: float) -> float:
    """Refuse a time limit that is not above 0, or above the longest one that systems can wait for."""
    if not 0 < seconds <= LONGEST_TIMEOUT:
        raise UserError(f"timeout: {seconds:g} s leaves no time, or sets no limit; give 0 to {LONGEST_TIMEOUT:g} s")
    return seconds


def results_folder(out: Path | None, main: str) -> AbstractContextManager[Path | None]:
    """Return the staged folder of the results, or a context of None without `out`."""
    return nullcontext() if out is None else staged_folder(out, main)


def draw(out: Path, beside: str) -> bool:
    """Draw the figures of the results in the file `beside` in `out`; return False if one fails."""
    from slamgauge.compare.figures.publishing import draw_stored  # here: matplotlib is slow to start

    return draw_stored(out, beside)


def finish(command: WithPage, out: Path, beside: str, *, done: bool) -> int:
    """Print where the results are, write their page, and return the exit status."""
    print(f"written to {out}", file=sys.stderr)
    return 0 if write_page(out, beside, command.page) and done else 1


def write_page(out: Path | None, beside: str, page: PageOptions) -> bool:
    """Write the page of the results in the file `beside` in `out`; return False if that fails.

    If the page fails, the other results are kept.
    """
    if out is None or page.no_report:
        return True
    from slamgauge.compare.report.page import pages_of, write_pages  # here: matplotlib is slow to start

    drawn = decorate(out, {"report": lambda stage: write_pages(stage, pages_of(out / beside))}, beside)
    if drawn and page.open:
        open_page(out)
    return drawn


def open_page(folder: Path) -> None:
    """Open the page of a folder in the browser."""
    if not webbrowser.open((folder / REPORT).resolve().as_uri()):
        print(f"no browser was found; open {folder / REPORT}", file=sys.stderr)


@contextmanager
def continued_later() -> Generator[None]:
    """Add to an interrupt how the command continues."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("finished runs are stored; the same command continues from there") from None
