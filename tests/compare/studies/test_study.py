"""Studies: what they store, how they go on, and that their figures are those of the runs."""

from __future__ import annotations

import json
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.figures.publishing import write_study
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.aggregation import FIRST_STEP
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.compare.storage.manifest import MANIFEST, write_manifest
from slamgauge.compare.storage.staged_folder import begin_file
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.cluster import dask_cluster
from slamgauge.compare.studies.executors import local_processes
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import Summary
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

NAMES = ("ekf", "riekf", "causal")
SHORT = ["start=sampled", "trajectory.duration=4"]  # as the fixture `scenario`


def figures_of(summary: Summary) -> dict[str, Any]:
    """All but computing times."""
    content = summary.to_json()
    for entry in content["estimators"].values():
        del entry["seconds_total"]
    return content


def test_seeds_are_independent_of_the_number_of_runs_and_all_different() -> None:
    seeds = [run_seed(0, run) for run in range(2000)]
    assert len(set(seeds) | {run_seed(1, run) for run in range(2000)}) == 4000
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_the_summary_is_that_of_the_runs(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    summary = run_study(scenario, 6, 3, NAMES, tmp_path, thread)
    ates, nees, errors, sigmas = {}, {}, {}, {}
    for name, estimator in load_estimators(NAMES).items():
        scores, paths, last = [], [], []
        for run in range(6):
            truth, recording = simulate(scenario, run_seed(3, run))
            estimate = estimator(recording)
            assert truth.poses is not None
            assert estimate.pose_covs is not None
            scores.append(evaluate(truth, recording, estimate))
            paths.append(np.square(estimate.poses[:, :2] - truth.poses[:, :2]).sum(axis=1))
            last.append(np.sqrt(np.diag(estimate.pose_covs[-1])))
        ates[name] = np.array([score.ate_m for score in scores])
        nees[name] = np.array([score.nees for score in scores])
        errors[name], sigmas[name] = np.array(paths), np.array(last)
    low, high = (bound / 6 for bound in chi2_band(0.999, 18))
    for name in NAMES:
        entry = summary.estimators[name]
        assert entry.runs == 6
        assert entry.ate_m is not None
        assert entry.ate_m.mean == pytest.approx(ates[name].mean(), rel=1e-12)
        assert entry.position_rmse_m is not None
        assert entry.position_rmse_m.mean == pytest.approx(np.sqrt(errors[name].mean(axis=0)).mean(), rel=1e-6)
        assert entry.nees_pose_per_dof is not None
        assert entry.nees_pose_per_dof.mean == pytest.approx(nees[name][:, FIRST_STEP:].mean() / 3, rel=1e-6)
        average = nees[name].mean(axis=0)
        assert entry.nees_share_inside_band == pytest.approx(np.mean((low <= average) & (average <= high)))
        assert entry.ratio_to_causal is not None
        assert entry.ratio_to_causal.mean == pytest.approx(ates[name].mean() / ates["causal"].mean(), rel=1e-12)
        assert entry.sigma_ratio_to_optimum_final == pytest.approx(
            tuple((sigmas[name] / sigmas["causal"]).mean(axis=0)), rel=1e-6
        )
    assert summary.estimators["causal"].ratio_to_hindsight is None


def test_a_study_goes_on_where_it_was_and_repeats_nothing(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run_study(scenario, 5, 0, ("ekf", "riekf"), tmp_path / "whole", thread)
    run_study(scenario, 2, 0, ("ekf",), tmp_path / "parts", thread)
    carried: list[tuple[int, tuple[str, ...]]] = []
    original = study_run.run_once

    def counted(each: Scenario, seed: int, asked: list[Asked]) -> list[study_run.Outcome]:
        carried.append((seed, tuple(one.label for one in asked)))
        return original(each, seed, asked)

    monkeypatch.setattr("slamgauge.compare.studies.study.run_once", counted)
    parts = run_study(scenario, 5, 0, ("ekf", "riekf"), tmp_path / "parts", thread)
    seeds = [run_seed(0, run) for run in range(5)]
    expected = [(seeds[0], ("riekf",)), (seeds[1], ("riekf",)), *((seed, ("ekf", "riekf")) for seed in seeds[2:])]
    assert carried == expected
    assert figures_of(parts) == figures_of(whole)
    carried.clear()
    fewer = run_study(scenario, 2, 0, ("ekf",), tmp_path / "parts", thread)
    assert not carried
    assert fewer.estimators["ekf"].runs == 2


def test_a_failing_run_is_recorded_shown_and_not_repeated(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seed = run_seed(0, 1)
    unlucky = simulate(scenario, seed)[1].odometry[0, 0]
    ekf = load_estimators(["ekf"])["ekf"]

    def fragile(recording: Recording, **_: object) -> Estimate:
        if recording.odometry[0, 0] == unlucky:
            raise ValueError("no luck")
        return ekf(recording)

    monkeypatch.setattr("slamgauge.ekf.riekf", fragile)
    for _ in range(2):
        summary = run_study(scenario, 3, 0, ("ekf", "riekf"), tmp_path, thread)
        (failure,) = summary.failures
        assert (failure.run, failure.estimator) == (1, "riekf")
        assert "no luck" in failure.error
        assert (summary.estimators["ekf"].runs, summary.estimators["riekf"].runs) == (3, 2)


@pytest.mark.parametrize(
    ("overrides", "seed", "message"),
    [(["sensor.max_range=8"], 0, "another scenario"), ([], 1, "another seed")],
)
def test_another_study_is_refused_with_the_remedy(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, overrides: list[str], seed: int, message: str
) -> None:
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    other = load_scenario("q1-long-dense", [*SHORT, *overrides])
    with pytest.raises(UserError, match=f"{message}.*give another --out"):
        run_study(other, 1, seed, ("ekf",), tmp_path, thread)
    assert run_study(scenario, 1, 0, ("ekf",), tmp_path, thread).estimators["ekf"].runs == 1


def test_a_file_that_is_no_store_is_refused(scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path) -> None:
    begin_file(tmp_path, "study.sqlite")
    (tmp_path / "study.sqlite").write_text("not a database, but long enough to be read as one " * 50)
    with pytest.raises(UserError, match=r"is damaged \(file is not a database\); move it away"):
        run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)


def test_databases_of_others_are_refused_and_stay_as_they_are(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    path = tmp_path / "study.sqlite"
    for table in ("patients (name TEXT)", "study (key TEXT, value TEXT)"):
        path.unlink(missing_ok=True)
        with sqlite3.connect(path) as connection:
            connection.execute(f"CREATE TABLE {table}")
        connection.close()
        before = path.read_bytes()
        with pytest.raises(ValueError, match=r"study.sqlite: exists already, .* has not written it; move it"):
            run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
        with pytest.raises(ValueError, match=r"no such table|holds no study"):
            load_runs(scenario, 1, 0, ("ekf",), tmp_path)
        assert path.read_bytes() == before
        assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_store_without_a_manifest_is_read_but_not_written(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    """As version 0.3 has left it."""
    run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    (tmp_path / MANIFEST).unlink()
    assert len(load_runs(scenario, 1, 0, ("ekf",), tmp_path)["ekf"].run) == 1
    with pytest.raises(ValueError, match=r"study.sqlite: exists already.* give another --out"):
        run_study(scenario, 2, 0, ("ekf",), tmp_path, thread)


@pytest.mark.parametrize("step", ["begin_file", "begin_store", "write_manifest"])
def test_a_study_killed_while_it_makes_its_store_goes_on(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Before anything is there, where the file is there and empty, and before it is settled whose that is."""
    module = "storage.manifest" if step == "write_manifest" else "studies.study"
    place = f"slamgauge.compare.{module}.{step}"
    original, calls = write_manifest, list[object]()

    def killed(*arguments: Any) -> None:
        calls.append(arguments)
        if step != "write_manifest" or len(calls) == 2:
            raise KeyboardInterrupt
        original(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(place, killed)
        with pytest.raises(KeyboardInterrupt):
            run_study(scenario, 1, 0, ("ekf",), tmp_path, thread)
    for runs in (1, 2):
        assert run_study(scenario, runs, 0, ("ekf",), tmp_path, thread).estimators["ekf"].runs == runs


@pytest.mark.parametrize(("runs", "seed", "names"), [(0, 0, ["ekf"]), (1, -1, ["ekf"]), (1, 0, ["efk"]), (1, 0, [])])
def test_bad_input_is_refused_before_anything_is_written(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, runs: int, seed: int, names: list[str]
) -> None:
    with pytest.raises(UserError, match=r"give at least 1|negative|did you mean ekf|name at least one"):
        run_study(scenario, runs, seed, names, tmp_path / "new", thread)
    assert not (tmp_path / "new").exists()


def test_processes_and_a_dask_cluster_give_the_same_figures_bit_for_bit(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path
) -> None:
    from distributed import LocalCluster

    here = run_study(scenario, 4, 0, NAMES, tmp_path / "here", thread)
    with local_processes(2) as executor:
        there = run_study(scenario, 4, 0, NAMES, tmp_path / "there", executor)
    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, dask_cluster(cluster.scheduler_address) as executor:
        far = run_study(scenario, 4, 0, NAMES, tmp_path / "far", executor)
    assert figures_of(here) == figures_of(there) == figures_of(far)
    blobs = [
        list(sqlite3.connect(tmp_path / place / "study.sqlite").execute("SELECT series FROM outcome ORDER BY 1"))
        for place in ("here", "there", "far")
    ]
    assert blobs[0] == blobs[1] == blobs[2]


@pytest.mark.usefixtures("studies_in_a_thread")
def test_the_command_prints_the_table_and_writes_summary_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "q1-long-dense", "--set", "trajectory.duration=3", "--runs", "3", "--jobs", "1"]
    words += ["--estimators", "ekf,causal,batch", "--out", str(tmp_path / "study")]
    assert main(words) == 0
    table = capsys.readouterr().out
    below = ["fit", "ekf:", "causal:", "batch:"]
    assert [line.split()[0] for line in table.splitlines()] == ["estimator", "ekf", "causal", "batch", *below]
    content = json.loads((tmp_path / "study" / "summary.json").read_text())
    origin = {"version", "command", "scenario_text"}
    assert set(content) == {
        *origin,
        "scenario",
        "runs",
        "seed",
        "digest",
        "failures",
        "estimators",
        "against",
        "precision",
    }
    assert set(content["estimators"]["ekf"]["ate_m"]) == {"mean", "low", "high"}
    assert content["estimators"]["ekf"]["nees_share_inside_band"]["level"] == 0.999
    for name in ("nees", "nis", "errors", "ratios"):
        assert (tmp_path / "study" / f"{name}.png").stat().st_size > 0
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) | {"command": ""} == content | {"command": ""}  # which has --json in it


def test_figures_of_a_study_in_which_everything_failed(
    scenario: Scenario, thread: ThreadPoolExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: Recording, **__: object) -> Estimate:
        raise ValueError("never")

    monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
    summary = run_study(scenario, 2, 0, ("ekf",), tmp_path, thread)
    write_study(tmp_path, summary, load_runs(scenario, 2, 0, ("ekf",), tmp_path), 0.1)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["estimators"]["ekf"]["ate_m"] is None
    assert len(content["failures"]) == 2


def test_several_threads_leave_standard_output_alone(scenario: Scenario, tmp_path: Path) -> None:
    before = sys.stdout
    with ThreadPoolExecutor(3) as executor:
        run_study(scenario, 6, 0, ("ekf", "riekf"), tmp_path, executor)
    assert sys.stdout is before


def test_there_is_nothing_to_load_where_no_study_was(scenario: Scenario, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no study"):
        load_runs(scenario, 1, 0, ("ekf",), tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()
