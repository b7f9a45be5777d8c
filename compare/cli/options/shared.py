"""Options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import HELP
from slamgauge.compare.scenarios.scenario_files import locate
from slamgauge.compare.storage.result_files import REPORT
from slamgauge.compare.storage.safe_names import file_name

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
Unconfined = Annotated[
    bool, tyro.conf.arg(help="No wall around your own code: for containers, which are walls (docs/your_filter.md).")
]
PATIENCE = 600.0  # s


@dataclass(kw_only=True)
class Options:
    """Options of a command."""

    def check(self) -> None:
        """Refuse a wrong value before slow libraries are imported; raise `UserError`."""


@dataclass(kw_only=True)
class OfScenario(Options):
    """Options of a command on a scenario."""

    scenario: Sampled

    def check(self) -> None:
        """Refuse a scenario that does not exist."""
        locate(self.scenario)


@dataclass(frozen=True)
class OwnCode:
    """How your own estimators are run."""

    strict: bool = False
    """Run your own code behind a wall (bubblewrap) without the truth, and reject poses that depend on the future."""

    timeout: float = PATIENCE
    """Largest time of a run of your own code, and of loading it [s]."""

    unconfined: Unconfined = False

    noise: Literal["recording", "file", "both"] = "recording"
    """Noise that your own code assumes: the recording's, that of its file, or one run with each."""


@dataclass(frozen=True)
class Work:
    """Where the runs are computed."""

    jobs: int = os.cpu_count() or 1
    """Worker processes, one BLAS thread each."""


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


def split_names(comma_separated: str) -> list[str]:
    """Split a comma-separated list."""
    return [name.strip() for name in comma_separated.split(",") if name.strip()]


def flattened(groups: Sequence[Sequence[str]]) -> list[str]:
    """Return the values of a repeated option in one list."""
    return [text for group in groups for text in group]


def named_after(out: Path, source: str | Path) -> Path:
    """Replace NAME in a default of --out by the name of a scenario, file or folder."""
    name = Path(source).resolve().name.removesuffix(".toml").removesuffix(".npz")
    return Path(str(out).replace("NAME", file_name(name)))


@dataclass(kw_only=True)
class WithPage(Options):
    """A command that prints a table, and explains its results on a page."""

    page: PageOptions = field(default_factory=PageOptions)

    output: Output = field(default_factory=Output)
