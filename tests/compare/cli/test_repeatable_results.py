"""Two runs of a command write equal results, apart from measured times, which have their own arrays, keys and cells."""

from __future__ import annotations

import csv
import json
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from tests.reference.fast_commands import studies_in_a_thread

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[3] / "examples"
SHORT = ("q1-short-dense", "--set", "trajectory.duration=3")
COMMANDS = (
    ("run", *SHORT, "--estimators", "ekf,causal", "--out", "run"),
    ("evaluate", "run/recording.npz", "--truth", "run/truth.npz", "--estimators", "ekf", "--out", "evaluation"),
    ("study", *SHORT, "--runs", "3", "--estimators", "ekf,riekf", "--jobs", "2", "--out", "study"),
    ("grade", "class", "--scenario", *SHORT, "--runs", "2", "--seed", "0", "--out", "grades"),
)
WITH_TIMES = {  # every other file is equal byte by byte
    *("run/metrics.json", "run/report.html", "run/estimates/ekf.npz", "run/estimates/causal.npz"),
    *("evaluation/metrics.json", "evaluation/report.html", "evaluation/estimates/ekf.npz"),
    *("study/summary.json", "study/study.sqlite"),
    *("grades/grades.csv", "grades/report.html"),
    *("grades/results.json", "grades/gradescope/student_ekf/results.json"),
}
TIMES = {"seconds", "seconds_total", "seconds_per_run", "execution_time"}  # names of keys


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return two folders with the results of the same commands."""
    folders = tmp_path_factory.mktemp("first"), tmp_path_factory.mktemp("second")
    for folder in folders:
        (folder / "class").mkdir()
        shutil.copy(EXAMPLES / "student_ekf.py", folder / "class")
        with pytest.MonkeyPatch.context() as patch, studies_in_a_thread():
            patch.chdir(folder)
            assert [main([*words]) for words in COMMANDS] == [0] * len(COMMANDS)
    return folders


def test_only_files_with_times_differ(twice: tuple[Path, Path]):
    first, second = (
        {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in twice
    )
    assert first.keys() == second.keys()
    assert {name for name in first if first[name] != second[name]} <= WITH_TIMES <= first.keys()


@pytest.mark.parametrize("name", sorted(WITH_TIMES))
def test_only_times_differ_in_these_files(twice: tuple[Path, Path], name: str):
    one, other = (WITHOUT_TIMES[Path(name).suffix](folder / name) for folder in twice)
    assert one == other


def test_two_checks_are_equal(capsys: pytest.CaptureFixture[str]):
    found: list[list[dict[str, Any]]] = []
    for _ in range(2):
        assert main(["check", "ekf", "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]


def _json(path: Path) -> object:
    return _without_times(json.loads(path.read_bytes()))


def _without_times(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _without_times(value) for key, value in content.items() if key not in TIMES}
    return [_without_times(each) for each in content] if isinstance(content, list) else content


def _npz(path: Path) -> object:
    with np.load(path) as arrays:
        return {name: arrays[name].tobytes() for name in arrays.files if name not in TIMES}


def _rows_of_store(path: Path) -> object:
    with closing(sqlite3.connect(path)) as store:
        rows = store.execute("SELECT run, estimator, seed, kind, error, figures, series FROM outcome ORDER BY 1, 2")
        return [(*head, _without_times(json.loads(figures)), series) for *head, figures, series in rows]


def _csv(path: Path) -> object:
    with path.open(newline="") as file:
        return _without_times([*csv.DictReader(file)])


def _html(path: Path) -> object:
    """Return a page without the last cells of rows, which are computing times."""
    return [re.sub(r"<td data-value=[^>]*>[^<]*</td></tr>", "</tr>", line) for line in path.read_text().splitlines()]


WITHOUT_TIMES: dict[str, Callable[[Path], object]] = {
    ".json": _json,
    ".npz": _npz,
    ".sqlite": _rows_of_store,
    ".csv": _csv,
    ".html": _html,
}
