"""Options and steps that several commands share."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import HELP
from slamgauge.compare.storage.result_files import REPORT
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scenarios.scenario import Scenario

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
Open = Annotated[bool, tyro.conf.arg(help=f"Open {REPORT} in the browser.")]
Form = Annotated[
    str, tyro.conf.arg(help="Form of your own code, if slamgauge does not recognise it: step, class, octave, ...")
]
Unconfined = Annotated[
    bool, tyro.conf.arg(help="Do not deny your own code other files and the network (docs/your_filter.md).")
]
PATIENCE = 600.0  # s
LONGEST_TIMEOUT = 1e6  # s; `select` counts milliseconds in 31 bits
MOST_JOBS = 1024


@dataclass(frozen=True)
class OwnCode:
    """How your own estimators are run."""

    strict: bool = False
    """Run your own code in a separate process that has no truth, and reject poses that depend on the future."""

    timeout: float | None = None
    """Run your own code in a separate process, and end a run after this time [s]. With --strict the default is 600."""

    unconfined: Unconfined = False

    noise: Literal["recording", "file", "both"] = "recording"
    """Noise that your own code assumes: the recording's, that of its file, or one run with each."""

    form: Form = ""

    def isolate(self, asked: list[Asked]) -> list[Asked]:
        """Set noise and form of user code among the requests; isolate it if it is strict or has a time limit."""
        from slamgauge.compare.estimators.requests import Isolation, isolated, with_noise_and_form

        asked = with_noise_and_form(asked, self.noise, self.form)
        if not self.strict and self.timeout is None:
            return asked
        seconds = PATIENCE if self.timeout is None else require_timeout(self.timeout)
        return isolated(asked, Isolation(seconds, self.strict, self.unconfined))


@dataclass(frozen=True)
class Work:
    """Where the runs are computed."""

    jobs: int = os.cpu_count() or 1
    """Worker processes, one BLAS thread each."""

    def executor(self) -> AbstractContextManager[Executor]:
        """Return an executor of worker processes."""
        from slamgauge.compare.studies.executors import local_processes

        if not 1 <= self.jobs <= MOST_JOBS:
            raise UserError(f"jobs: {self.jobs} is out of range; give 1 to {MOST_JOBS}")
        return local_processes(self.jobs)


@dataclass(frozen=True)
class PageOptions:
    """The page that explains the results."""

    no_report: bool = False
    """Do not write report.html next to the results."""

    open: Open = False


class EmptyPathError(Exception):
    """An empty path, which `Path` takes for the current folder. Not a `UserError`: tyro would change its text."""


def _path(words: list[str]) -> Path:
    if not words[0]:
        raise EmptyPathError("'' is an empty path; name a folder, . for the current one")
    return Path(words[0])


Folder = Annotated[
    Path,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="PATH",
        instance_from_str=_path,
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda path: [str(path)],
    ),
]


def require_scenario(scenario: str) -> None:
    """Refuse a scenario that does not exist, before slow libraries are imported."""
    from slamgauge.compare.scenarios.scenario_files import locate

    locate(scenario)


def overridden_scenario(scenario: str, overrides: Sequence[Sequence[str]]) -> Scenario:
    """Load a scenario with the values of --set."""
    from slamgauge.compare.scenarios.scenario import load_scenario

    return load_scenario(scenario, flattened(overrides))


def require_timeout(seconds: float) -> float:
    """Refuse a time limit that is not above 0, or above the longest one that systems can wait for."""
    if not 0 < seconds <= LONGEST_TIMEOUT:
        raise UserError(f"timeout: {seconds:g} s leaves no time, or sets no limit; give 0 to {LONGEST_TIMEOUT:g} s")
    return seconds


def split_names(comma_separated: str) -> list[str]:
    """Split a comma-separated list."""
    return [name.strip() for name in comma_separated.split(",") if name.strip()]


def flattened(groups: Sequence[Sequence[str]]) -> list[str]:
    """Return the values of a repeated option in one list."""
    return [text for group in groups for text in group]


def results_folder(
    out: Path | None, writes: Sequence[str], last: str, outdated: Sequence[str] = ()
) -> AbstractContextManager[Path | None]:
    """Return the staged folder of the results, or a context of None without `out`."""
    from slamgauge.compare.storage.staged_folder import staged_folder

    return nullcontext() if out is None else staged_folder(out, writes, last, outdated)


def named_after(out: Path, source: str | Path) -> Path:
    """Replace NAME in a default of --out by the name of a scenario, file or folder."""
    from slamgauge.compare.storage.safe_names import file_name

    name = Path(source).resolve().name.removesuffix(".toml").removesuffix(".npz")
    return Path(str(out).replace("NAME", file_name(name)))


@dataclass(kw_only=True)
class WithPage:
    """A command that prints a table, and explains its results on a page."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)

    def finish(self, out: Path, beside: str, *, done: bool) -> int:
        """Print where the results are, write their page, and return the exit status."""
        print(f"written to {out}", file=sys.stderr)
        return 0 if write_page(out, beside, self.page) and done else 1


def write_page(out: Path | None, beside: str, page: PageOptions) -> bool:
    """Write the page of the results in the file `beside` in `out`; return False if that fails.

    If the page fails, the other results are kept.
    """
    if out is None or page.no_report:
        return True
    from slamgauge.compare.report.publishing import pages_of, write_pages
    from slamgauge.compare.storage.best_effort import decorate

    drawn = decorate(out, {"report": lambda stage: write_pages(stage, pages_of(out / beside))}, [REPORT])
    if drawn and page.open:
        open_page(out)
    return drawn


def open_page(folder: Path) -> None:
    """Open the page of a folder in the browser."""
    import webbrowser

    if not webbrowser.open((folder / REPORT).resolve().as_uri()):
        print(f"no browser was found; open {folder / REPORT}", file=sys.stderr)
