"""Stores with flipped bits and missing ends are refused in a line, and a store is used by one command at a time."""

from __future__ import annotations

import math
import random
import re
import sqlite3
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies.store_file import sole_use
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.errors import UserError

RUNS = 6
NAMES = ("ekf", "dead-reckoning")
REMEDY = "move it away or give another --out, and run the study again"


@pytest.fixture
def whole(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> Path:
    """The store of a small study, without side files."""
    run_study(scenario, RUNS, 0, NAMES, tmp_path / "whole", thread)
    return tmp_path / "whole/study.sqlite"


def assert_same(found: dict[str, Runs], expected: dict[str, Runs]) -> None:
    for name, runs in expected.items():
        assert found[name].kind == runs.kind
        np.testing.assert_array_equal(found[name].run, runs.run)
        for key in runs.figures:
            np.testing.assert_array_equal(found[name].figures[key], runs.figures[key])
        for key, series in runs.series.items():
            np.testing.assert_array_equal(found[name].series[key], series)


def test_a_damaged_store_gives_the_right_figures_or_is_refused_in_a_line(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    """Flipped bits, overwritten bytes, pages of zeros, missing ends."""
    expected = load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    good, moments = whole.read_bytes(), random.Random(0)
    refused = 0
    for case in range(60):
        bad = bytearray(good)
        at = moments.randrange(len(bad))
        if case % 4 == 0:
            bad[at] ^= 1 << moments.randrange(8)
        elif case % 4 == 1:
            bad[at : at + 8] = moments.randbytes(8)
        elif case % 4 == 2:
            bad[at - at % 4096 : at - at % 4096 + 4096] = bytes(4096)
        else:
            del bad[at:]
        whole.write_bytes(bytes(bad))
        try:
            run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
        except UserError as error:
            assert re.fullmatch(rf"{whole}: [^\n]+", str(error))
            refused += 1
        else:
            assert_same(load_runs(scenario, RUNS, 0, NAMES, whole.parent), expected)
    assert refused > 40


def test_a_row_with_another_content_is_named(scenario: Scenario, thread: ThreadPoolExecutor, whole: Path) -> None:
    with closing(sqlite3.connect(whole)) as connection, connection:
        query = "UPDATE outcome SET figures = replace(figures, '\"ate_m\": 0.', '\"ate_m\": 1.') WHERE run = 3"
        assert connection.execute(f"{query} AND estimator = 'ekf'").rowcount == 1
    message = rf"^{whole}: is damaged \(checksums do not match: run 3 of ekf\); {REMEDY}$"
    with pytest.raises(UserError, match=message):
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with pytest.raises(UserError, match=message):
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)


@pytest.mark.parametrize("odd", [b'"', b'"\xd7', b'"\x1b[2J'])
def test_sqlites_message_about_a_broken_file_is_one_line(
    odd: bytes, scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    """The definition of a table has a quotation mark without its partner, followed by bytes that are not UTF-8."""
    content = whole.read_bytes()
    assert content.count(b"TEXT NOT NULL,\n    error") == 1
    cut = b"TEXT NOT NULL,\n    error".replace(b"TEXT NOT"[: len(odd)], odd)
    whole.write_bytes(content.replace(b"TEXT NOT NULL,\n    error", cut))
    with pytest.raises(UserError) as reading:
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with pytest.raises(UserError) as continuing:
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    for told in (str(reading.value), str(continuing.value)):
        assert "malformed database schema" in told
        assert told.isprintable()


def test_a_store_whose_checksums_have_another_name_is_refused(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    """One changed byte in the definition of the table must not turn off the check of the rows."""
    whole.write_bytes(whole.read_bytes().replace(b"checksum TEXT", b"checkstm TEXT"))
    message = rf"is damaged \(the table outcome has other columns\); {REMEDY}$"
    with pytest.raises(UserError, match=message):
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with pytest.raises(UserError, match=message):
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)


def test_a_second_study_in_the_same_folder_is_refused_at_once(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    begun = time.monotonic()
    with (
        sole_use(whole),
        pytest.raises(UserError, match=rf"^{whole}: another command is using it; wait for it, or give another"),
    ):
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    assert time.monotonic() - begun < 5.0
    assert not whole.with_name("study.sqlite-lock").exists()
    run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)


def test_a_store_that_another_program_holds_is_said_at_once(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    begun = time.monotonic()
    with closing(sqlite3.connect(whole)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(UserError, match=rf"^{whole}: another program is using it .*; close that, and give the"):
            run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    assert time.monotonic() - begun < 10.0


class _Full(Executor):
    """Takes a few runs, and then no more."""

    def __init__(self) -> None:
        self.taken = 0

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        self.taken += 1
        if self.taken > 100:
            raise InterruptedError
        return Future()


def test_runs_are_not_listed_before_they_are_carried_out(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of as many as no memory holds, which is why they would be refused."""
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: math.inf)
    executor, begun = _Full(), time.monotonic()
    with pytest.raises(InterruptedError):
        run_study(scenario, 10**9, 0, NAMES, tmp_path, executor)
    assert executor.taken == 101
    assert time.monotonic() - begun < 10.0
