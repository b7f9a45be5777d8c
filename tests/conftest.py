"""What all tests share."""

from __future__ import annotations

import gc
import re
from collections.abc import Generator
from pathlib import Path

import pytest

from slamgauge import compile_progress
from slamgauge.compare.cli import terminal
from tests.reference import fast_commands

HERE = Path(__file__).parent


def gtsam_is_missing() -> bool:
    """Whether GTSAM cannot be had; `PYTHONPATH=tests/without_gtsam` makes it so."""
    try:
        import gtsam  # noqa: F401  # pyright: ignore[reportUnusedImport]
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
OPTIMA_OF_GTSAM = re.compile("robust.(batch|optimum)|fixed.lag")  # in the names of tests that are told an estimator
collect_ignore = [f"graph_baseline/{name}" for name in OF_GTSAM if WITHOUT_GTSAM]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files beside this one take long: none of them is left for one worker when the others are done."""
    items.sort(key=lambda item: item.path.parent != HERE)
    for item in items:
        needed = item.get_closest_marker("gtsam") is not None or OPTIMA_OF_GTSAM.search(item.name)
        if WITHOUT_GTSAM and needed:
            item.add_marker(pytest.mark.skip(reason="GTSAM cannot be had here"))


def pytest_collection_finish() -> None:
    """Tests and modules stay: commands that look for garbage need not go through thousands of them each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def whole_lines(monkeypatch: pytest.MonkeyPatch):
    """Commands print what they say in whole lines here; `compare/cli/test_terminal.py` tests how lines are broken."""
    monkeypatch.setattr(terminal, "PIPED", 10_000)


@pytest.fixture(autouse=True)
def silent_compiler(monkeypatch: pytest.MonkeyPatch):
    """How long kernels take to load is the machine's affair; `slamgauge/test_compiling.py` tests what is said of it."""
    monkeypatch.setattr(compile_progress, "ANNOUNCE_AFTER", 3600.0)


@pytest.fixture
def studies_in_a_thread() -> Generator[None]:
    with fast_commands.studies_in_a_thread():
        yield


@pytest.fixture
def empty_pictures() -> Generator[None]:
    with fast_commands.empty_pictures():
        yield
