"""Which stores a study goes on with, and what it says of the others."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from slamgauge import __version__
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scoring.runs import SERIES
from slamgauge.compare.studies import store as study_store
from slamgauge.compare.studies import store_damage
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.errors import UserError

HELD = {1: "8dfa411309eb131a"}  # of each schema number, a digest of the tables and series


def about(folder: Path) -> dict[str, str]:
    """What the store in the folder says of itself."""
    with closing(sqlite3.connect(folder / "study.sqlite")) as connection:
        return dict(connection.execute("SELECT key, value FROM study"))


def test_another_version_goes_on_with_the_study(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    monkeypatch.setattr(study_store, "__version__", "9.9.9")
    both = run_study(scenario, 2, 0, ("ekf",), tmp_path, thread)
    assert (first.digest, both.estimators["ekf"].runs) == (both.digest, 2)
    assert about(tmp_path)["version"] == __version__


def test_another_schema_is_refused_in_a_line_with_the_remedy(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    monkeypatch.setattr(study_store, "SCHEMA", study_store.SCHEMA + 1)
    message = r"has schema \d+ \(begun by slamgauge .*\), this is schema \d+ .*; finish it with that version, or give"
    with pytest.raises(UserError, match=message) as caught:
        run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    assert "\n" not in str(caught.value)


def test_a_store_of_version_0_3_is_refused_in_a_line(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    """It has no schema number and no checksums."""
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        connection.execute("DELETE FROM study WHERE key IN ('schema', 'names')")
        connection.execute("UPDATE study SET value = '0.3.0' WHERE key = 'version'")
        connection.execute("ALTER TABLE outcome DROP COLUMN checksum")
    for again in (
        lambda: run_study(scenario, 2, 0, ("ekf",), tmp_path, thread),
        lambda: load_runs(scenario, 1, 0, ("ekf",), tmp_path),
    ):
        with pytest.raises(UserError, match=r"^[^\n]+has schema of old .begun by slamgauge 0.3.0.[^\n]+$"):
            again()


def test_the_schema_number_is_raised_with_the_tables(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    """Other tables or series make old rows unreadable: raise `SCHEMA`, and note the digest in `HELD`."""
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection:
        tables = connection.execute("SELECT sql FROM sqlite_master WHERE type = 'table' ORDER BY name").fetchall()
    held = hashlib.sha256(json.dumps([tables, SERIES]).encode()).hexdigest()[:16]
    assert {study_store.SCHEMA: held} == {study_store.SCHEMA: HELD[study_store.SCHEMA]}


def as_written_by_0_4(scenario: Scenario) -> str:
    """The scenario as JSON without most keys that have their default, and with the rays of version 0.3."""
    content = scenario.model_copy(update={"fis": scenario.fis.model_copy(update={"alpha": 0.3, "beta": 2.0})})
    return content.model_dump_json(exclude={"prior": {"covariance"}, "association": {"node_limit"}, "update": True})


@pytest.fixture
def begun_with_0_4(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> Path:
    """A study folder as version 0.4 left it, which called the causal optimum isam2."""
    run_study(scenario, 1, 0, ("causal",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        connection.execute("DELETE FROM study WHERE key = 'names'")
        connection.execute("UPDATE study SET value = '0.4.0' WHERE key = 'version'")
        connection.execute("UPDATE study SET value = ? WHERE key = 'scenario'", (as_written_by_0_4(scenario),))
        connection.execute("UPDATE study SET value = ? WHERE key = 'digest'", ("0" * 64,))
    return tmp_path


@pytest.mark.parametrize("name", ["isam2", "isam2@ekf"])
def test_a_study_of_0_4_that_holds_isam2_is_refused_in_a_line(
    scenario: Scenario, thread: ThreadPoolExecutor, begun_with_0_4: Path, name: str
) -> None:
    store = begun_with_0_4 / "study.sqlite"
    study = run_study(scenario, 1, 0, ("causal",), begun_with_0_4.with_name("new"), thread)
    rows = sqlite3.connect(begun_with_0_4.with_name("new") / "study.sqlite").execute("SELECT * FROM outcome").fetchall()
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("DELETE FROM outcome")
        row = (rows[0][0], name, *rows[0][2:-1])
        checked = store_damage.with_checksum(row)
        connection.execute(store_damage.INSERT, checked)
    message = "begun before slamgauge 0.5, when 'isam2' was the name of the causal optimum, now 'causal'"
    for again in (
        lambda: run_study(scenario, 1, 0, ("ekf",), begun_with_0_4, thread),
        lambda: load_runs(scenario, 1, 0, ("ekf",), begun_with_0_4),
        lambda: study_store.read_store(store, study.digest, ("ekf",), 1),
    ):
        with pytest.raises(UserError, match=message) as caught:
            again()
        assert "\n" not in str(caught.value)


def test_a_study_of_0_4_without_isam2_goes_on_and_may_then_hold_it(
    scenario: Scenario, thread: ThreadPoolExecutor, begun_with_0_4: Path
) -> None:
    for names in (("causal",), ("causal", "isam2"), ("causal", "isam2")):
        assert run_study(scenario, 1, 0, names, begun_with_0_4, thread).estimators["causal"].runs == 1
    assert about(begun_with_0_4)["version"] == "0.4.0"
    assert about(begun_with_0_4)["digest"] == digest(scenario, 0)


def test_figures_that_old_rows_lack_are_unknown(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    """A study that was begun before they existed goes on, and its old runs are not repeated."""
    run_study(scenario, 2, 0, ("causal",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        rows = connection.execute("SELECT figures FROM outcome WHERE run = 0").fetchall()
        later = ("optimum_check_sigma", "chi_square_per_dof")
        old = {key: figure for key, figure in json.loads(rows[0][0]).items() if key not in later}
        new = {**old, "optimum_check_sigma": np.inf, "chi_square_per_dof": 1.25}
        for run, figures in enumerate((old, new)):
            connection.execute("UPDATE outcome SET figures = ? WHERE run = ?", (json.dumps(figures), run))
            row = connection.execute(f"SELECT {store_damage.COLUMNS} FROM outcome WHERE run = ?", (run,)).fetchone()
            checksum = store_damage.with_checksum(row)[-1]
            connection.execute("UPDATE outcome SET checksum = ? WHERE run = ?", (checksum, run))
    held = load_runs(scenario, 2, 0, ("causal",), tmp_path)["causal"].figures
    np.testing.assert_array_equal(held["optimum_check_sigma"], [np.nan, np.inf])
    np.testing.assert_array_equal(held["chi_square_per_dof"], [np.nan, 1.25])
    entry = run_study(scenario, 2, 0, ("causal",), tmp_path, thread).estimators["causal"].to_json()
    assert entry["optimum_check_share"] == 1.0
    assert entry["chi_square_per_dof"] == {"mean": 1.25, "low": None, "high": None}
    json.dumps(entry, allow_nan=False)


def test_a_full_disk_is_no_fault_of_the_store(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    with (
        pytest.raises(UserError, match=r"cannot be written \(.*full\); make room, and give the same command again"),
        study_store.open_store(tmp_path / "study.sqlite", scenario, 0) as store,
    ):
        store._connection.execute("PRAGMA max_page_count = 1")  # pyright: ignore[reportPrivateUsage]
        store.add(1, 0, [Outcome("ekf", series=bytes(1_000_000))])
    assert run_study(scenario, 2, 0, ("ekf",), tmp_path, thread).estimators["ekf"].runs == 2


def test_rays_change_only_studies_of_bearing_only_sensors() -> None:
    for name, same in (("q1-short-dense", True), ("q4-ring", False)):
        digests = {digest(load_scenario(name, ["start=sampled", *words]), 0) for words in ([], ["fis.lost_after=4"])}
        assert (len(digests) == 1) == same


def test_a_study_continues_with_another_description(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    first = run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    other = scenario.model_copy(update={"description": "described in other words"})
    assert digest(other, 0) == first.digest
    assert run_study(other, 2, 0, ("ekf",), tmp_path, thread).estimators["ekf"].runs == 2
