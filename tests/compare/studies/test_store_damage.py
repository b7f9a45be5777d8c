"""Stores with flipped bits and cut ends: found, named, and mended at the cost of the runs that are hit."""

from __future__ import annotations

import math
import random
import re
import sqlite3
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing, suppress
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import store_damage
from slamgauge.compare.studies.store_damage import INSERT, TABLES, readable_rows, with_checksum
from slamgauge.compare.studies.store_file import sole_use
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.errors import UserError

RUNS = 6
NAMES = ("ekf", "dead-reckoning")
TIMES = ("seconds_total",)  # another time another time


@pytest.fixture
def whole(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> Path:
    """The store of a small study, without side files."""
    run_study(scenario, RUNS, 0, NAMES, tmp_path / "whole", thread)
    return tmp_path / "whole/study.sqlite"


def put(folder: Path, content: bytes) -> Path:
    """A folder whose store holds this, as ours."""
    (folder / "study.sqlite").write_bytes(content)
    return folder


def assert_same(found: dict[str, Runs], expected: dict[str, Runs]) -> None:
    for name, runs in expected.items():
        assert found[name].kind == runs.kind
        np.testing.assert_array_equal(found[name].run, runs.run)
        for key in runs.figures.keys() - {*TIMES}:
            np.testing.assert_array_equal(found[name].figures[key], runs.figures[key])
        for key, series in runs.series.items():
            np.testing.assert_array_equal(found[name].series[key], series)


def test_wherever_a_store_is_damaged_the_figures_are_right_or_it_is_refused_in_a_line(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bits that flip, bytes that are overwritten, pages that are zero, ends that are cut off."""
    expected = load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    good, moments = whole.read_bytes(), random.Random(0)
    mended = refused = 0
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
        put(whole.parent, bytes(bad))
        capsys.readouterr()
        try:
            run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
        except UserError as error:
            assert re.fullmatch(rf"{whole}: [^\n]+", str(error))
            refused += 1
            continue
        lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("slamgauge")]
        assert all(line.startswith(f"slamgauge: {whole}: was damaged (") for line in lines)
        mended += bool(lines)
        assert_same(load_runs(scenario, RUNS, 0, NAMES, whole.parent), expected)
    assert mended > 20
    assert refused < 25  # where the file says what it is


def test_a_row_that_says_something_else_is_named_and_its_run_alone_is_carried_out_again(
    scenario: Scenario,
    thread: ThreadPoolExecutor,
    whole: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with closing(sqlite3.connect(whole)) as connection, connection:
        query = "UPDATE outcome SET figures = replace(figures, '\"ate_m\": 0.', '\"ate_m\": 1.') WHERE run = 3"
        assert connection.execute(f"{query} AND estimator = 'ekf'").rowcount == 1
    with pytest.raises(UserError, match=r"study.sqlite: is damaged \(run 3 of ekf is not what its checksum says\);"):
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    carried: list[tuple[int, list[str]]] = []
    submit = thread.submit

    def noted(work: Any, scenario: Scenario, seed: int, asked: Any) -> Future[Any]:
        carried.append((seed, [each.label for each in asked]))
        return submit(work, scenario, seed, asked)

    monkeypatch.setattr(thread, "submit", noted)
    capsys.readouterr()
    run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    assert [names for _, names in carried] == [["ekf"]]
    told = "11 rows are whole and stay, what lacks is carried out again: run 3 of ekf"
    line = f"slamgauge: {whole}: was damaged (run 3 of ekf is not what its checksum says): {told}"
    assert line in capsys.readouterr().err.splitlines()
    assert_same(load_runs(scenario, RUNS, 0, NAMES, whole.parent), expected)


@pytest.mark.parametrize("odd", [b'"', b'"\xd7', b'"\x1b[2J'])
def test_what_sqlite_quotes_of_a_broken_file_is_told_in_one_line(
    odd: bytes, scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    """In the text of its tables a quotation mark is open to the end, with bytes behind it that are no text."""
    content = whole.read_bytes()
    assert content.count(b"TEXT NOT NULL,\n    error") == 1
    cut = b"TEXT NOT NULL,\n    error".replace(b"TEXT NOT"[: len(odd)], odd)
    put(whole.parent, content.replace(b"TEXT NOT NULL,\n    error", cut))
    with pytest.raises(UserError) as reading:
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with pytest.raises(UserError) as going_on:
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    for told in (str(reading.value), str(going_on.value)):
        assert "malformed database schema" in told
        assert told.isprintable()


def as_of_old(path: Path) -> None:
    """Without checksums, as version 0.3 has left it."""
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("ALTER TABLE outcome DROP COLUMN checksum")


def test_a_store_from_before_checksums_gets_them(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    as_of_old(whole)
    expected = load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)
    assert "damaged" not in capsys.readouterr().err
    assert_same(load_runs(scenario, RUNS, 0, NAMES, whole.parent), expected)
    with closing(sqlite3.connect(whole)) as connection:
        assert connection.execute("SELECT count(*) FROM outcome WHERE length(checksum) = 64").fetchone() == (12,)


def test_a_store_whose_checksums_have_another_name_is_none_from_before_them(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    """One byte of the table's text; rows would be believed unchecked."""
    put(whole.parent, whole.read_bytes().replace(b"checksum TEXT", b"checkstm TEXT"))
    with pytest.raises(UserError, match=r"is damaged \(the columns of its tables are not what they were\)"):
        load_runs(scenario, RUNS, 0, NAMES, whole.parent)
    with pytest.raises(UserError, match=r"and cannot be mended; move it away or"):
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)


def test_a_damaged_store_from_before_checksums_is_refused(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    as_of_old(whole)
    put(whole.parent, whole.read_bytes()[: -3 * 4096])
    with pytest.raises(UserError, match=r"^\S+study.sqlite: is damaged \(.+\), and cannot be mended; move it away or"):
        run_study(scenario, RUNS, 0, NAMES, whole.parent, thread)


def test_a_second_study_in_the_same_folder_is_refused_at_once(
    scenario: Scenario, thread: ThreadPoolExecutor, whole: Path
) -> None:
    begun = time.monotonic()
    with (
        sole_use(whole),
        pytest.raises(UserError, match=rf"^{whole}: another command is at work on it; wait for it, or give another"),
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


def test_pages_that_lead_back_to_themselves_come_to_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page in the place of another: SQLite then reads the rows behind it again and again."""
    monkeypatch.setattr(store_damage, "MOST_LOST", 100)
    path, size, runs = tmp_path / "study.sqlite", 4096, 12
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(TABLES)
        rows = [with_checksum((run, "ekf", 0, "filtered", None, "{}", bytes(1500))) for run in range(runs)]
        with connection:
            connection.executemany(INSERT, rows)
    good, again = path.read_bytes(), 0
    for at, other in product(range(0, len(good), size), repeat=2):
        path.write_bytes(good[:at] + good[other : other + size] + good[at + size :])
        with closing(sqlite3.connect(path)) as connection, suppress(sqlite3.DatabaseError):
            found = connection.execute("SELECT rowid FROM outcome NOT INDEXED ORDER BY rowid")
            again += len([*islice(found, runs + 1)]) > runs
        with closing(sqlite3.connect(path)) as connection, suppress(sqlite3.DatabaseError):
            assert len([*islice(readable_rows(connection), runs + 1)]) <= runs
    assert again > 0
