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
from slamgauge.compare.scoring.catalogue import LATER, STORED
from slamgauge.compare.scoring.runs import SERIES
from slamgauge.compare.studies import store as study_store
from slamgauge.compare.studies import store_damage
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import Outcome
from slamgauge.errors import UserError

HELD = {1: "1e8420eb23df3370"}  # of each schema number, a digest of the columns


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


@pytest.mark.parametrize(("version", "schema"), [("0.3.0", "1"), ("0.2.0", "of old")])
def test_a_store_without_a_schema_number_has_that_of_its_version(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, version: str, schema: str
) -> None:
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        connection.execute("DELETE FROM study WHERE key = 'schema'")
        connection.execute("UPDATE study SET value = ? WHERE key = 'version'", (version,))
    if schema == str(study_store.SCHEMA):
        assert run_study(scenario, 2, 0, ("ekf",), tmp_path, thread).estimators["ekf"].runs == 2
        assert about(tmp_path) | {"schema": schema, "version": version} == about(tmp_path)
    else:
        with pytest.raises(UserError, match=f"has schema {schema} .begun by slamgauge {version}"):
            run_study(scenario, 2, 0, ("ekf",), tmp_path, thread)


def test_the_schema_number_is_raised_with_what_a_store_holds(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    """A figure more or less makes old rows unreadable: raise `SCHEMA`, and note its columns in `HELD`.

    A further one that old rows may lack goes into `LATER`.
    """
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection:
        tables = connection.execute("SELECT sql FROM sqlite_master WHERE type = 'table' ORDER BY name").fetchall()
    assert {*LATER} < {*STORED}
    first = [key for key in STORED if key not in LATER]
    held = hashlib.sha256(json.dumps([tables, SERIES, first]).encode()).hexdigest()[:16]
    assert {study_store.SCHEMA: held} == {study_store.SCHEMA: HELD[study_store.SCHEMA]}


@pytest.fixture
def begun_with_0_4(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> Path:
    """A study folder as version 0.4 left it, which called the causal optimum isam2."""
    run_study(scenario, 1, 0, ("causal",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        connection.execute("DELETE FROM study WHERE key = 'names'")
        connection.execute("UPDATE study SET value = '0.4.0' WHERE key = 'version'")
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


def test_figures_that_old_rows_lack_are_unknown(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    """A study that was begun before they existed goes on, and its old runs are not repeated."""
    run_study(scenario, 2, 0, ("causal",), tmp_path, thread)
    with closing(sqlite3.connect(tmp_path / "study.sqlite")) as connection, connection:
        rows = connection.execute("SELECT figures FROM outcome WHERE run = 0").fetchall()
        old = {key: figure for key, figure in json.loads(rows[0][0]).items() if key not in LATER}
        new = {**old, "optimum_check_sigma": np.inf, "chi_square_per_dof": 1.25}
        connection.execute("UPDATE outcome SET figures = ? WHERE run = 0", (json.dumps(old),))
        connection.execute("UPDATE outcome SET figures = ? WHERE run = 1", (json.dumps(new),))
        connection.execute("ALTER TABLE outcome DROP COLUMN checksum")  # as it was then
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


def test_the_digest_of_a_scenario_is_that_of_version_0_3_0() -> None:
    """Keys that were added since have their defaults; one that is chosen makes another study."""
    known = "6d69de30a7ee"  # summary.json of `slamgauge study q1-short-dense --runs 1 --out ...`, version 0.3.0
    assert digest(load_scenario("q1-short-dense", ["start=sampled"]), 0).startswith(known)
    assert not digest(load_scenario("q1-short-dense", ["start=sampled", "fis.lost_after=4"]), 0).startswith(known)


def test_bearings_without_chosen_rays_are_another_study_than_in_version_0_3_0() -> None:
    """Rays had other members then; whoever asks for those has the study of then."""
    known = "b499e6de32f9"  # summary.json of `slamgauge study q4-ring --runs 1 --out ...`, version 0.3.0
    former = ("fis.alpha=0.3", "fis.beta=2.0", "fis.s_min=1.0")
    assert not digest(load_scenario("q4-ring", ["start=sampled"]), 0).startswith(known)
    assert digest(load_scenario("q4-ring", ["start=sampled", *former]), 0).startswith(known)
