"""Options and steps that several commands share."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators import requests
from slamgauge.compare.estimators.registry import HELP
from slamgauge.compare.figures import publishing as figures
from slamgauge.compare.report import page as pages
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.scenarios.scenario_files import locate
from slamgauge.compare.storage import staged_folder
from slamgauge.compare.storage.result_files import REPORT, file_name
from slamgauge.compare.studies import executors
from slamgauge.errors import UserError

USER_CODE = "Your own: [LABEL=]FILE.py, FILE.py:callable or package.module:callable. THIS LOADS AND RUNS THAT CODE."
Estimators = Annotated[str, tyro.conf.arg(help=f"{HELP} {USER_CODE}")]
NAMED = "A shipped scenario (`slamgauge scenarios` lists them) or the path of a TOML file"
Sampled = Annotated[
    tyro.conf.Positional[str],
    tyro.conf.arg(help=f"{NAMED}. Each run draws its true start from the prior; --set start=mean fixes it."),
]
RootSeed = Annotated[int, tyro.conf.arg(help="Root seed. The seed of each run is spawned from it.")]
Repeated = Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction]
Overrides = Annotated[Repeated, tyro.conf.arg(help="Override keys of the scenario: dotted.key=value ...")]
Unconfined = Annotated[
    bool, tyro.conf.arg(help="No wall around your own code: for containers, which are walls (docs/your_filter.md).")
]
LONGEST_TIMEOUT = 1e6  # s; `select` counts milliseconds in 31 bits
MOST_JOBS = 1024


@dataclass(kw_only=True)
class OfScenario:
    """Options of a command on a scenario."""

    scenario: Sampled
    set: Overrides = field(default_factory=list)

    def load(self) -> scenarios.Scenario:
        """Load the scenario with the values of --set; a wrong name is refused before slow libraries are imported."""
        locate(self.scenario)
        return scenarios.load_scenario(self.scenario, flattened(self.set))


@dataclass(frozen=True)
class OwnCode:
    """How your own estimators are run.

    Attributes:
        strict: Run your own code behind a wall (bubblewrap) without the truth, and reject poses that depend on the
            future.
        timeout: Largest time of a run of your own code, and of loading it [s].
        noise: Noise that your own code assumes: the recording's, that of its file, or one run with each.
    """

    strict: bool = False
    timeout: float = 600.0
    unconfined: Unconfined = False
    noise: Literal["recording", "file", "both"] = "recording"

    def ask(self, names: str) -> list[requests.Asked]:
        """Return the estimators of a comma-separated list, with noise and limits of user code among them."""
        limits = requests.Limits(require_timeout(self.timeout), self.strict and not self.unconfined)
        asked = requests.with_noise(requests.ask(split_names(names)), self.noise)
        return requests.with_limits(asked, limits, strict=self.strict)


@dataclass(frozen=True)
class Work:
    """Where the runs are computed.

    Attributes:
        jobs: Worker processes, one BLAS thread each.
    """

    jobs: int = os.cpu_count() or 1

    def executor(self) -> AbstractContextManager[Executor]:
        """Return an executor of worker processes."""
        if not 1 <= self.jobs <= MOST_JOBS:
            raise UserError(f"jobs: {self.jobs} is out of range; give 1 to {MOST_JOBS}")
        return executors.local_processes(self.jobs)


@dataclass(frozen=True)
class PageOptions:
    """The page that explains the results.

    Attributes:
        no_report: Do not write report.html next to the results.
        open: Open report.html in the browser.
    """

    no_report: bool = False
    open: bool = False

    def write(self, out: Path | None, main: str) -> bool:
        """Write the page of the results that `main` marks in `out`; return False if that fails. Results are kept."""
        if out is None or self.no_report:
            return True
        drawing = {"report": lambda stage: pages.write_pages(stage, pages.pages_of(out / main))}
        done = staged_folder.decorate(out, drawing, main)
        if done:
            self.show(out)
        return done

    def show(self, folder: Path) -> None:
        """Open the page of a folder in the browser, if that is requested."""
        if self.open and not webbrowser.open((folder / REPORT).resolve().as_uri()):
            print(f"no browser was found; open {folder / REPORT}", file=sys.stderr)


@dataclass(kw_only=True)
class WithPage:
    """A command that prints a table, and explains its results on a page."""

    page: PageOptions = field(default_factory=PageOptions)
    output: Output = field(default_factory=Output)

    def finish(self, out: Path | None, main: str, *, done: bool = True) -> int:
        """Draw the results that `main` marks in `out`, and write their page; return the exit status."""
        if out is not None:
            done = (main not in figures.KINDS or figures.draw_stored(out, main)) and done
            print(f"written to {out}", file=sys.stderr)
        return 0 if self.page.write(out, main) and done else 1


def split_names(comma_separated: str) -> list[str]:
    """Split a comma-separated list."""
    return [name.strip() for name in comma_separated.split(",") if name.strip()]


def flattened(groups: Sequence[Sequence[str]]) -> list[str]:
    """Return the values of a repeated option in one list."""
    return [text for group in groups for text in group]


def results_of(kind: str, source: str | Path) -> Path:
    """Return the default of --out: `results/KIND-NAME` with the name of a scenario, file or folder."""
    name = Path(source).resolve().name.removesuffix(".toml").removesuffix(".npz")
    return Path("results", f"{kind}-{file_name(name)}")


def require_timeout(seconds: float) -> float:
    """Refuse a time limit that is not above 0, or above the longest one that systems can wait for."""
    if not 0 < seconds <= LONGEST_TIMEOUT:
        raise UserError(f"timeout: {seconds:g} s leaves no time, or sets no limit; give 0 to {LONGEST_TIMEOUT:g} s")
    return seconds


def staged(out: Path | None, main: str) -> AbstractContextManager[Path | None]:
    """Return the staged folder of the results, or a context of None without `out`."""
    return nullcontext() if out is None else staged_folder.staged_folder(out, main)
