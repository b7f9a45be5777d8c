"""What several commands take and do."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgauge.compare.cli.streams import put
from slamgauge.compare.cli.terminal import laid_out
from slamgauge.compare.estimators.registry import FILTERS, HELP
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from slamgauge.compare.estimators.requests import Asked
    from slamgauge.compare.scenarios.scenario import Scenario

OWN = "Your own: [LABEL=]FILE.py:callable or [LABEL=]package.module:callable. THIS LOADS AND RUNS THAT CODE."
Estimators = Annotated[str, tyro.conf.arg(help=f"{HELP} {OWN}")]
FilterName = Annotated[
    str,
    tyro.conf.arg(
        help=f"The filter whose error is split: {', '.join(FILTERS)}. {OWN}",
        aliases=["--estimators"],  # as every other command calls it
    ),
]
Overrides = Annotated[list[tuple[str, ...]], tyro.conf.UseAppendAction]
PATIENCE = 600.0  # s
ALL_CORES = os.cpu_count() or 1
MOST_JOBS = 1024


@dataclass(frozen=True)
class OwnCode:
    """How estimators of your own are run."""

    strict: bool = False
    """Run your own code in processes of its own, without the truth, and refuse poses that use the future."""

    timeout: float | None = None
    """Seconds that your own code may take for a run, in a process of its own; 600 with --strict."""

    def kept_apart(self, asked: list[Asked]) -> list[Asked]:
        """People's own code in processes of its own, if it is to be strict or has a time-out."""
        from slamgauge.compare.estimators.requests import Isolation, isolated

        if not self.strict and self.timeout is None:
            return asked
        seconds = PATIENCE if self.timeout is None else require_timeout(self.timeout)
        return isolated(asked, Isolation(seconds, self.strict))


@dataclass(frozen=True)
class Work:
    """Who carries out the runs."""

    jobs: int = ALL_CORES
    """Worker processes, one BLAS thread each."""


class EmptyPathError(Exception):
    """A path of no characters, which would mean the current folder; no `UserError`, which tyro would reword."""


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


def sampled_scenario(scenario: str, overrides: Sequence[Sequence[str]]) -> Scenario:
    """The scenario with the true start drawn from the prior, as statistics need it, unless it is overridden."""
    from slamgauge.compare.scenarios.scenario import load_scenario

    return load_scenario(scenario, ["start=sampled", *flattened(overrides)])


def carried_by(jobs: int, scheduler: str | None = None) -> AbstractContextManager[Executor]:
    """Who carries the runs."""
    if scheduler is not None:
        from slamgauge.compare.studies.executors import dask_cluster

        return dask_cluster(scheduler)
    if not 1 <= jobs <= MOST_JOBS:
        raise UserError(f"jobs: {jobs} processes carry nothing, or the machine does not; give 1 to {MOST_JOBS}")
    from slamgauge.compare.studies.executors import local_processes

    return local_processes(jobs)


def require_timeout(seconds: float) -> float:
    """A time that people's code may take."""
    if not 0 < seconds < math.inf:
        raise UserError(f"timeout: {seconds:g} s leaves no time, or no end; give seconds > 0")
    return seconds


def split_names(comma_separated: str) -> list[str]:
    """The names in a comma-separated list."""
    return [name.strip() for name in comma_separated.split(",") if name.strip()]


def results_folder(
    out: Path | None, writes: Sequence[str], last: str, outdated: Sequence[str] = ()
) -> AbstractContextManager[Path | None]:
    """The staged folder for results, or nothing to write to."""
    from slamgauge.compare.storage.staged_folder import staged_folder

    return nullcontext() if out is None else staged_folder(out, writes, last, outdated)


def named_after(out: Path, source: str | Path) -> Path:
    """A default of --out with NAME in it, for the scenario, file or folder that `source` is."""
    from slamgauge.compare.storage.safe_names import file_name

    name = Path(source).resolve().name.removesuffix(".toml").removesuffix(".npz")
    return Path(str(out).replace("NAME", file_name(name)))


def flattened(groups: Sequence[Sequence[str]]) -> list[str]:
    """The words of an option that was given several times, in one list."""
    return [text for group in groups for text in group]


def print_result(result: object) -> bool:
    """Print a page (tables) or a text, or anything else as JSON, on standard output; whether that took it."""
    from slamgauge.compare.scoring.text_page import Page

    if isinstance(result, Page):
        result = laid_out(result)
    return put(result if isinstance(result, str) else json.dumps(result, indent=2, allow_nan=False))
