"""User code in studies: identified by its digest, loaded from its folder or a copy, run again after edits."""

from __future__ import annotations

import importlib
import pickle
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.studies.executors import dask_cluster
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.study_run import run_once
from slamgauge.ekf import dead_reckoning, ekf_slam
from slamgauge.errors import UserError

from .conftest import EXAMPLES, short

pytestmark = pytest.mark.slow

MINE = "from helper import chosen\ndef estimate(recording):\n    return chosen(recording)\n"
HELPER = "from slamgauge.ekf import {} as chosen\n"
SHORT = ["start=sampled", "trajectory.duration=2"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "helper.py").write_text(HELPER.format("ekf_slam"))
    (tmp_path / "other.py").write_text("")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_edited_code_is_another_estimator(folder: Path) -> None:
    scenario, address = load_scenario("q1-short-dense", SHORT), ["ekf", "mine=mine.py:estimate"]
    with ThreadPoolExecutor(1) as executor:
        first = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
        (folder / "helper.py").write_text(HELPER.format("dead_reckoning"))
        edited = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
        (folder / "helper.py").write_text(HELPER.format("ekf_slam"))
        again = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
    assert first["mine"]["ate_m"] == first["ekf"]["ate_m"] == again["mine"]["ate_m"]
    assert edited["mine"]["ate_m"] != first["mine"]["ate_m"]
    assert edited["ekf"] == first["ekf"]


def test_an_edited_installed_module_is_another_estimator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "installed_filter").mkdir()
    keys = set[str]()
    for content in ("", "edited = 1"):
        for name in ("__init__", "gains"):
            (tmp_path / f"installed_filter/{name}.py").write_text(content)
            importlib.invalidate_caches()
            keys.add(ask(["mine=installed_filter.gains:estimate"])[0].key)
    assert len(keys) == 4
    assert ask(["mine=numpy:array"])[0].key == ask(["mine=numpy:array"])[0].key != ask(["mine=scipy:array"])[0].key


def test_a_pickled_request_keeps_its_sources(folder: Path) -> None:
    (asked,) = pickle.loads(pickle.dumps(ask(["mine.py:estimate"])))
    (folder / "helper.py").write_text("raise ImportError\n")
    recording = short("q1-short-dense", "trajectory.duration=2")
    assert (load(asked)(recording).poses == ekf_slam(recording).poses).all()


def test_code_is_copied_to_the_workers_of_a_cluster(folder: Path) -> None:
    from distributed import LocalCluster

    scenario, asked = load_scenario("q1-short-dense", SHORT), ask(["ekf", "mine=mine.py:estimate"])
    for path in folder.glob("*.py"):
        path.unlink()  # another machine has none of them
    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, dask_cluster(cluster.scheduler_address) as executor:
        summary = run_study(scenario, 4, 0, asked, folder / "study", executor)
    assert summary.failures == ()
    assert summary.estimators["mine"]["ate_m"] == summary.estimators["ekf"]["ate_m"]


def test_a_map_without_ids_causes_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (outcome,) = run_once(load_scenario("q2-short-dense", SHORT), 0, [f"{EXAMPLES}/student_ekf.py:ekf_slam"])
    assert outcome.error is None
    assert outcome.figures["landmark_rmse_m"] is None


def test_a_study_takes_callables_and_lists_failures_by_label(folder: Path) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    chosen = {"ours": "ekf", "theirs": dead_reckoning, "broken": fails}
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(load_scenario("q1-short-dense", SHORT), 1, 0, chosen, folder / "study", executor)  # pyrefly: ignore[bad-argument-type]
    assert [*summary.estimators] == [*chosen]
    assert {failure.estimator for failure in summary.failures} == {"broken"}


@pytest.mark.parametrize("chosen", [["a=mine.py:estimate", "a=other.py:f"], {"ekf": dead_reckoning}, {"a/b": ekf_slam}])
def test_labels_that_are_refused(folder: Path, chosen: object) -> None:
    assert folder.exists()
    with pytest.raises(UserError):
        ask(chosen)  # pyrefly: ignore[bad-argument-type]
