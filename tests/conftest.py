"""Fixtures and hooks of all tests."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from slamgauge import jit, notices
from slamgauge.blas_threads import pin_blas_threads
from slamgauge.compare.cli import terminal
from slamgauge.compare.figures import plot_style
from tests.kernels import compile_kernels
from tests.reference import fast_commands

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # imports numpy, which must not precede slamgauge: it pins BLAS's threads

gc.disable()  # until all tests are collected
pin_blas_threads()  # the tests run on all cores already
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each program that tests start would compile all its modules


def gtsam_is_missing() -> bool:
    """Return whether GTSAM cannot be imported, for example with `PYTHONPATH=tests/without_gtsam`."""
    try:
        import gtsam  # noqa: F401
    except ImportError:
        return True
    return False


WITHOUT_GTSAM = gtsam_is_missing()
OF_GTSAM = (  # they import it
    "test_gtsam_batch.py",
    "test_gtsam_incremental.py",
    "test_hard_recordings.py",
    "problem/test_linearisation.py",
    "test_optimum.py",
)
collect_ignore = [f"graph_baseline/{name}" for name in OF_GTSAM if WITHOUT_GTSAM]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="run also the tests marked `full`: long statistics, real logs")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Run all tests on all cores, and chosen files in this process; some tests wait, hence one worker more."""
    is_worker, chosen = hasattr(config, "workerinput"), config.args != config.getini("testpaths")
    if not (is_worker or chosen or config.option.usepdb) and config.option.numprocesses is None:
        config.option.numprocesses = (os.cpu_count() or 1) + 1
        config.option.dist = "loadfile"


def pytest_configure(config: pytest.Config) -> None:
    """Compile kernels once, before the workers would each do so."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        compile_kernels()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select the tests, and run slow files first: a worker must not begin one when the others are done."""
    if not (config.getoption("--full") or "full" in config.getoption("-m")):
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("full")])
        items[:] = [item for item in items if not item.get_closest_marker("full")]
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
    for item in items:
        if WITHOUT_GTSAM and item.get_closest_marker("gtsam"):
            item.add_marker(pytest.mark.skip(reason="GTSAM cannot be imported"))


def pytest_collection_finish() -> None:
    """Exclude tests and modules from garbage collection, which commands run often."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def whole_lines(monkeypatch: pytest.MonkeyPatch):
    """Print messages of commands without line breaks; `compare/cli/test_terminal.py` tests line breaks."""
    monkeypatch.setattr(terminal, "PIPED", 10_000)


@pytest.fixture(autouse=True)
def silent_compiler(monkeypatch: pytest.MonkeyPatch):
    """Disable the message about a first use, which `core/test_jit.py` tests."""
    monkeypatch.setattr(jit, "tell_once", lambda _: None)


@pytest.fixture
def no_notices_yet(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(notices, "TOLD", set())


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """Saved figures by name; no files are written."""
    found: dict[str, Figure] = {}

    def keep(figure: Figure, path: Path) -> None:
        found[path.name] = figure

    monkeypatch.setattr(plot_style, "save_printed", keep)
    return found


@pytest.fixture
def studies_in_a_thread() -> Generator[None]:
    with fast_commands.studies_in_a_thread():
        yield


@pytest.fixture
def empty_pictures() -> Generator[None]:
    with fast_commands.empty_pictures():
        yield
