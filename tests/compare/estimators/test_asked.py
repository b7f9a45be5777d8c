"""People's own code in studies: by its digest, from its folder or from a copy, edited and run anew."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from slamgauge.compare.estimators.asked import ask
from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.sources import sources_of
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.studies.study import run_study
from slamgauge.ekf import dead_reckoning, ekf
from slamgauge.errors import UserError

MINE = "from helper import chosen\ndef estimate(recording):\n    return chosen(recording)\n"
HELPER = "from slamgauge.ekf import {} as chosen\n"
SHORT = ["start=sampled", "trajectory.duration=2"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "helper.py").write_text(HELPER.format("ekf"))
    (tmp_path / "other.py").write_text("")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_sources_are_what_a_file_imports_from_its_folder(folder: Path) -> None:
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
        (folder / "helper.py").write_text(HELPER.format("ekf"))
        (folder / "other.py").write_text("X = 1\n")
        again = run_study(scenario, 2, 0, address, folder / "study", executor).estimators
    assert first["mine"].figure("ate_m") == first["ekf"].figure("ate_m") == again["mine"].figure("ate_m")
    assert edited["mine"].figure("ate_m") != first["mine"].figure("ate_m")
    assert edited["ekf"] == first["ekf"]


def test_code_travels_and_stays_what_it_was(folder: Path) -> None:
    (asked,) = pickle.loads(pickle.dumps(ask(["mine.py:estimate"])))
    (folder / "helper.py").write_text("raise ImportError\n")
    recording = __import__("slamgauge").simulate(load_scenario("q1-short-dense", SHORT), 0)[1]
    assert (load(asked)(recording).poses == ekf(recording).poses).all()


def test_a_study_takes_callables_and_names_failures_by_their_labels(folder: Path) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    chosen = {"ours": "ekf", "theirs": dead_reckoning, "broken": fails, "nothing": "mine.py:nothing"}
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(load_scenario("q1-short-dense", SHORT), 1, 0, chosen, folder / "study", executor)  # pyright: ignore[reportArgumentType]
    assert [*summary.estimators] == [*chosen]
    assert {failure.estimator for failure in summary.failures} == {"broken", "nothing"}


@pytest.mark.parametrize("chosen", [["a=mine.py:estimate", "a=other.py:f"], {"ekf": dead_reckoning}, {"a/b": ekf}])
def test_labels_that_are_refused(folder: Path, chosen: object) -> None:
    assert folder.exists()
    with pytest.raises(UserError):
        ask(chosen)  # pyright: ignore[reportArgumentType]
