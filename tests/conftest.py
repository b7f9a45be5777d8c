"""Fixtures and hooks of all tests."""

from __future__ import annotations

import gc
import re
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from slamgauge import jit
from slamgauge.compare.cli import terminal
from slamgauge.compare.estimators.wall import NO_WALL, kind_of_wall
from slamgauge.compare.figures import plot_style
from slamgauge.notices import tell_once
from tests.reference import fast_commands
from tests.sizes import SIZES, size_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # imports numpy, which must not precede slamgauge: it pins BLAS's threads

HERE = Path(__file__).parent


def gtsam_is_missing() -> bool:
    """Return whether GTSAM cannot be imported, for example with `PYTHONPATH=tests/without_gtsam`."""
    try:
        import gtsam  # noqa: F401
    except ImportError:
        return True
    return False


WITHOUT_GTSAM = gtsam_is_missing()
OF_GTSAM = (
    "test_gtsam_batch.py",
    "test_gtsam_fixed_lag.py",
    "test_gtsam_isam2.py",
    "test_hard_recordings.py",
    "problem/test_linearisation.py",
    "test_optimum.py",
)
OPTIMA_OF_GTSAM = re.compile("robust.(batch|optimum)|fixed.lag")  # in the names of tests with an estimator as parameter
collect_ignore = [f"graph_baseline/{name}" for name in OF_GTSAM if WITHOUT_GTSAM]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--size", choices=SIZES, default="full", help="tests to run, see tests/sizes.py")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select the tests of the size, and run long files first: a worker must not begin one when the others are done."""
    size = SIZES.index(config.getoption("--size"))
    larger = [item for item in items if SIZES.index(size_of(item.nodeid)) > size]
    config.hook.pytest_deselected(items=larger)
    items[:] = [item for item in items if SIZES.index(size_of(item.nodeid)) <= size]
    items.sort(key=lambda item: (size_of(item.nodeid) == "quick", item.path.parent != HERE))
    for item in items:
        needed = item.get_closest_marker("gtsam") is not None or OPTIMA_OF_GTSAM.search(item.name)
        if WITHOUT_GTSAM and needed:
            item.add_marker(pytest.mark.skip(reason="GTSAM cannot be had here"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Skip a test that fails because this system can build no wall around user code, and say so."""
    report = yield
    if report.failed and kind_of_wall() == "none" and NO_WALL in f"{report.longreprtext}{report.capstderr}":
        report.outcome, report.longrepr = "skipped", (str(item.path), 0, f"Skipped: {NO_WALL}")
    return report


def pytest_collection_finish() -> None:
    """Exclude tests and modules from garbage collection, which commands run often."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def whole_lines(monkeypatch: pytest.MonkeyPatch):
    """Print messages of commands without line breaks; `compare/cli/test_terminal.py` tests line breaks."""
    monkeypatch.setattr(terminal, "PIPED", 10_000)


@pytest.fixture(autouse=True)
def silent_compiler(monkeypatch: pytest.MonkeyPatch):
    """Disable the message about a first use, which `core/test_jit.py` tests."""
    monkeypatch.setattr(jit, "announce", lambda: None)


@pytest.fixture
def no_notices_yet() -> Generator[None]:
    tell_once.cache_clear()
    yield
    tell_once.cache_clear()


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
