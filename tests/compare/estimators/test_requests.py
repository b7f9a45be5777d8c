"""User code in studies: identified by its digest, loaded from its folder or a copy, run again after edits."""

from __future__ import annotations

import importlib
import pickle
import signal
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import ask
from slamgauge.compare.estimators.sources import sources_of
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.studies.executors import dask_cluster
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import run_once
from slamgauge.ekf import dead_reckoning, ekf_slam
from slamgauge.errors import UserError
from tests.reference import wild_steps

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


def test_sources_contain_the_imports_of_a_file_from_its_folder(folder: Path) -> None:
    (folder / "mine.py").write_text(f"def late():\n    import pack.deep\n{MINE}")
    (folder / "pack").mkdir()
    for name in ("__init__", "deep"):
        (folder / f"pack/{name}.py").write_text("")
    assert [path for path, _ in sources_of(folder, "mine").files] == [
        "helper.py",
        "mine.py",
        "pack/__init__.py",
        "pack/deep.py",
    ]


def test_edited_code_is_another_estimator(folder: Path) -> None:
    scenario, address = load_scenario("q1-short-dense", SHORT), ["ekf", "mine=mine.py:estimate"]
    with ThreadPoolExecutor(1) as executor:
        first = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
        (folder / "helper.py").write_text(HELPER.format("dead_reckoning"))
        edited = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
        (folder / "helper.py").write_text(HELPER.format("ekf_slam"))
        (folder / "other.py").write_text("X = 1\n")
        again = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
    assert first["mine"]["ate_m"] == first["ekf"]["ate_m"] == again["mine"]["ate_m"]
    assert edited["mine"]["ate_m"] != first["mine"]["ate_m"]
    assert edited["ekf"] == first["ekf"]


def test_a_study_prints_once_what_loading_and_runs_replace(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "mine.py").write_text(f"{wild_steps.COLUMNS}\nprint('simulated')\n")
    scenario = load_scenario("q1-short-dense", SHORT)
    with ThreadPoolExecutor(1) as executor:
        run_study(scenario, 3, 0, ["replaced=mine.py"], folder / "study", executor)
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("slamgauge: replaced: ")]
    assert "not run: it only simulates, draws or prints" in lines[0]
    for text in ("Q of the file", "Py of the file", "its arrays of one element are converted"):
        assert len([line for line in lines if text in line]) == 1
    assert len(lines) == 4


@pytest.mark.parametrize("program", ["step.m", "my_slam"])
def test_an_edited_program_is_another_estimator(folder: Path, program: str) -> None:
    command = 'adapters.external(["./my_slam", "{recording}", "{estimate}"])'
    (folder / "mine.py").write_text(f"from slamgauge import adapters\n\nestimate = {command}\n")
    (folder / program).write_text("first")
    first = sources_of(folder, "mine").digest
    (folder / "notes.txt").write_text("does not count")
    assert sources_of(folder, "mine").digest == first
    (folder / program).write_text("edited")
    assert sources_of(folder, "mine").digest != first


def test_a_data_file_that_the_code_names_counts_in_the_digest(tmp_path: Path):
    code = "WEIGHTS = open('weights.txt', 'r').read()\nopen('log.txt', 'a').close()\nFolder('maps') / 'hall.txt'\n"
    (tmp_path / "package/maps").mkdir(parents=True)
    (tmp_path / "package/__init__.py").write_text("")
    (tmp_path / "package/mine.py").write_text(code)
    for name in ("weights.txt", "other.txt", "log.txt", "maps/hall.txt"):
        (tmp_path / "package" / name).write_text("1")
    for folder, module in ((tmp_path / "package", "mine"), (tmp_path, "package.mine")):
        first = sources_of(folder, module)
        files = {"package/__init__.py", "package/maps/hall.txt", "package/mine.py", "package/weights.txt"}
        beside = {each.removeprefix("package/") for each in files} - {"__init__.py"}
        assert {path for path, _ in first.files} == (files if "." in module else beside)
        (tmp_path / "package/other.txt").write_text(module)
        assert sources_of(folder, module).digest == first.digest
        for name in ("weights.txt", "maps/hall.txt"):
            before = sources_of(folder, module).digest
            (tmp_path / "package" / name).write_text(module)
            assert sources_of(folder, module).digest != before


def test_an_edited_installed_module_is_another_estimator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("installed_filter/__init__.py", "installed_filter/gains.py", "helper_beside_it.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("import helper_beside_it\n")
    keys = [ask(["mine=installed_filter.gains:estimate"])[0].key]
    for name in ("installed_filter/__init__.py", "helper_beside_it.py"):
        (tmp_path / name).write_text("edited = 1")
        importlib.invalidate_caches()
        keys.append(ask(["mine=installed_filter.gains:estimate"])[0].key)
    assert len({*keys}) == 3
    assert ask(["mine=numpy:array"])[0].key == ask(["mine=numpy:array"])[0].key != ask(["mine=scipy:array"])[0].key


@pytest.mark.parametrize("way", ["PYTHONPATH", "sys.path"])
def test_a_library_elsewhere_counts_in_the_digest(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    library, folder = tmp_path / "library", tmp_path / "mine"
    for each in (library, folder):
        each.mkdir()
    adding = "import sys\nsys.path.insert(0, '../library')\n" if way == "sys.path" else ""
    (folder / "mine.py").write_text(f"{adding}import tuned_library\n")
    (library / "tuned_library.py").write_text("from tuned_numbers import SCALE\n")
    (library / "tuned_numbers.py").write_text("SCALE = 1\n")
    if way == "PYTHONPATH":
        monkeypatch.setenv("PYTHONPATH", str(library))
    first = sources_of(folder, "mine")
    assert [path for path, _ in first.files] == ["mine.py"]
    assert sources_of(folder, "mine").digest == first.digest
    (library / "tuned_numbers.py").write_text("SCALE = 2\n")
    assert sources_of(folder, "mine").digest != first.digest


def test_a_pickled_request_keeps_its_sources(folder: Path) -> None:
    (asked,) = pickle.loads(pickle.dumps(ask(["mine.py:estimate"])))
    (folder / "helper.py").write_text("raise ImportError\n")
    recording = short("q1-short-dense", "trajectory.duration=2")
    assert (load(asked)(recording).poses == ekf_slam(recording).poses).all()


def test_a_loaded_step_function_can_be_pickled(folder: Path) -> None:
    (folder / "mine.py").write_text("DT = Q = Py = 1.0\ndef ekf_slam(xEst, PEst, u, y):\n    return xEst + DT, PEst\n")
    loaded = load(ask(["mine.py:ekf_slam"])[0])
    recording = short("q1-short-dense", "trajectory.duration=2", "sensor.max_range=0.1")
    assert (pickle.loads(pickle.dumps(loaded))(recording).poses == loaded(recording).poses).all()


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


def test_a_killed_study_of_user_code_continues(folder: Path) -> None:
    """The code kills its study in the third run, once."""
    source = """
import os, signal, time
from slamgauge.ekf import ekf_slam

def estimate(recording):
    with open("runs", "a+") as file:
        file.write("x")
        if file.tell() == 3:
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)
    return ekf_slam(recording)
"""
    (folder / "mine.py").write_text(source)
    command = [sys.executable, "-m", "slamgauge", "study", "q1-short-dense", "--set", "trajectory.duration=2"]
    command += ["--runs", "4", "--jobs", "1", "--estimators", "ekf,mine=mine.py:estimate", "--out", "study"]
    statuses = [subprocess.run(command, capture_output=True, check=False).returncode for _ in range(2)]
    assert statuses == [-signal.SIGKILL, 0]
    assert len((folder / "runs").read_text()) in (5, 6)  # the third again, and the second if it was not stored yet
    runs = load_runs(load_scenario("q1-short-dense", SHORT), 4, 0, ["ekf", "mine=mine.py:estimate"], folder / "study")
    assert len(runs["mine"].run) == 4
    assert (runs["mine"].figures["ate_m"] == runs["ekf"].figures["ate_m"]).all()


def test_a_map_without_ids_causes_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (outcome,) = run_once(load_scenario("q2-short-dense", SHORT), 0, [f"{EXAMPLES}/student_ekf.py:ekf_slam"])
    assert outcome.error is None
    assert outcome.figures["landmark_error_near_m"] is None


def test_a_study_takes_callables_and_lists_failures_by_label(folder: Path) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    chosen = {"ours": "ekf", "theirs": dead_reckoning, "broken": fails, "nothing": "mine.py:nothing"}
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(load_scenario("q1-short-dense", SHORT), 1, 0, chosen, folder / "study", executor)  # pyrefly: ignore[bad-argument-type]
    assert [*summary.estimators] == [*chosen]
    assert {failure.estimator for failure in summary.failures} == {"broken", "nothing"}


@pytest.mark.parametrize("chosen", [["a=mine.py:estimate", "a=other.py:f"], {"ekf": dead_reckoning}, {"a/b": ekf_slam}])
def test_labels_that_are_refused(folder: Path, chosen: object) -> None:
    assert folder.exists()
    with pytest.raises(UserError):
        ask(chosen)  # pyrefly: ignore[bad-argument-type]
