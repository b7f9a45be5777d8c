"""Studies: figures agree with the runs, stored runs are not repeated, bad input is refused; tables for papers."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from concurrent.futures import wait
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.compare.scoring.runs import FIRST_STEP, Runs
from slamgauge.compare.scoring.scores import evaluate
from slamgauge.compare.scoring.table import LATEX
from slamgauge.compare.studies import study_run as study_run
from slamgauge.compare.studies.executors import dask_cluster, local_processes
from slamgauge.compare.studies.stored_study import study_table
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.compare.studies.summary import Summary
from slamgauge.errors import UserError
from tests.reference import fast_commands
from tests.reference.given import given

from .conftest import figures_of

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[3] / "examples/student_ekf.py"

Run = Callable[..., Summary]
Load = Callable[..., dict[str, Runs]]

BOTH = ("ekf", "riekf")
NAMES = (*BOTH, "causal")
SHORT = ["start=sampled", "trajectory.duration=4"]  # same as the fixture `scenario`


def test_seeds_are_different_and_independent_of_the_number_of_runs() -> None:
    seeds = [run_seed(0, run) for run in range(2000)]
    assert len(set(seeds) | {run_seed(1, run) for run in range(2000)}) == 4000
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_the_summary_agrees_with_the_runs(scenario: Scenario, run: Run) -> None:
    summary = run(6, NAMES, seed=3)
    simulated = [simulate(scenario, run_seed(3, number)) for number in range(6)]
    ates, nees, errors = dict[str, Float](), dict[str, Float](), dict[str, Float]()
    for name, estimator in load_estimators(NAMES).items():
        estimates = [estimator(recording) for _, recording in simulated]
        scores = [evaluate(*pair, estimate) for pair, estimate in zip(simulated, estimates, strict=True)]
        paths = [given(truth.poses) for truth, _ in simulated]
        ates[name] = np.array([score["ate_m"] for score in scores])
        nees[name] = np.array([score.nees for score in scores])
        offsets = np.array([one.poses - other for one, other in zip(estimates, paths, strict=True)])
        errors[name] = np.square(offsets[:, :, :2]).sum(axis=2)
    for name in NAMES:
        entry = summary.estimators[name]
        assert entry["ate_m"].mean == pytest.approx(ates[name].mean(), rel=1e-12)
        assert entry["ratio_to_causal"].mean == pytest.approx(ates[name].mean() / ates["causal"].mean(), rel=1e-12)
        assert entry["position_rmse_m"].mean == pytest.approx(np.sqrt(errors[name].mean(axis=0)).mean(), rel=1e-6)
        assert entry["nees_pose_per_dof"].mean == pytest.approx(nees[name][:, FIRST_STEP:].mean() / 3, rel=1e-6)
        assert entry["runs"] == 6


def test_an_interrupted_study_continues_and_repeats_nothing(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(5, BOTH, "whole")
    run(2, ("ekf",), "parts")
    original, left, done = study_run.run_once, [0], list[tuple[int, tuple[str, ...]]]()

    def counted(each: Scenario, seed: int, asked: list[Asked]) -> list[study_run.Outcome]:
        if len(done) == left[0]:
            raise KeyboardInterrupt
        done.append((seed, tuple(one.label for one in asked)))
        return original(each, seed, asked)

    monkeypatch.setattr("slamgauge.compare.studies.study.run_once", counted)
    monkeypatch.setattr("slamgauge.compare.studies.study.IN_FLIGHT", 1)
    for left[0] in (2, 3):  # the second time after a single run more
        with pytest.raises(KeyboardInterrupt):
            run(5, BOTH, "parts")
    left[0] = 5
    assert figures_of(run(5, BOTH, "parts")) == figures_of(whole)
    seeds = [run_seed(0, number) for number in range(5)]
    assert done == [(seeds[0], ("riekf",)), (seeds[1], ("riekf",)), *((seed, BOTH) for seed in seeds[2:])]
    assert run(2, ("ekf",), "parts").estimators["ekf"]["runs"] == 2
    monkeypatch.undo()
    with local_processes(2) as executor:
        run(7, BOTH, "parts", executor=executor)  # additional runs in the store change nothing
    assert figures_of(run(5, BOTH, "parts")) == figures_of(whole)


def test_runs_that_end_together_with_a_defect_are_stored(run: Run, load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    def defective(each: Scenario, seed: int, asked: list[Asked]) -> list[study_run.Outcome]:
        if seed == run_seed(0, 1):
            raise RuntimeError("defect")
        return study_run.run_once(each, seed, asked)

    monkeypatch.setattr("slamgauge.compare.studies.study.run_once", defective)
    monkeypatch.setattr("slamgauge.compare.studies.study.first_done", lambda pending: wait(pending).done)
    with pytest.raises(RuntimeError, match="defect"):
        run(4, ("ekf",))
    assert load(4, ("ekf",))["ekf"].run.tolist() == [0, 2, 3]


def test_a_store_of_another_study_is_refused(run: Run) -> None:
    run(1, ("ekf",))
    with pytest.raises(UserError, match=r"another scenario.*give another --out"):
        run(1, ("ekf",), scenario=load_scenario("q1-long-dense", [*SHORT, "sensor.max_range=8"]))
    with pytest.raises(UserError, match=r"another seed.*give another --out"):
        run(1, ("ekf",), seed=1)
    assert run(1, ("ekf",)).estimators["ekf"]["runs"] == 1


def test_a_foreign_database_is_refused_and_unchanged(run: Run, load: Load, tmp_path: Path) -> None:
    path = tmp_path / "study.sqlite"
    with pytest.raises(UserError, match="no study is there"):
        load(1, ("ekf",))
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE patients (name TEXT)")
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"exists already, .* has not made it .*; move it"):
        run(1, ("ekf",))
    with pytest.raises(ValueError, match="no such table"):
        load(1, ("ekf",))
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.full  # tests/compare/estimators has a cluster
def test_processes_and_a_dask_cluster_give_the_same_figures_bit_for_bit(run: Run, tmp_path: Path) -> None:
    from distributed import LocalCluster

    here = run(4, NAMES, "here")
    with local_processes(2) as executor:
        there = run(4, NAMES, "there", executor=executor)
    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, dask_cluster(cluster.scheduler_address) as executor:
        far = run(4, NAMES, "far", executor=executor)
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
    keys = "version command scenario_text scenario runs seed digest failures estimators per_run against request"
    assert set(content) == set(keys.split())
    assert set(content["estimators"]["ekf"]["ate_m"]) == {"mean", "low", "high"}
    for name in ("nees", "nis", "errors", "ratios"):
        assert (tmp_path / "study" / f"{name}.png").stat().st_size > 0
    mine = ["--estimators", f"mine={EXAMPLE}:ekf_slam", "--noise", "both", "--out", str(tmp_path / "mine")]
    with fast_commands.empty_pictures():
        assert main([*words, "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert printed | {"command": ""} == content | {"command": ""}  # the command has --json
        assert main([*words, *mine]) == 0
    assert "mine (own noise)" in (tmp_path / "mine" / "report.html").read_text()


def interval(mean: float) -> dict[str, float]:
    return {"mean": mean, "low": mean - 0.5, "high": mean + 0.5}


@pytest.fixture
def study(tmp_path: Path) -> Path:
    entry = {"runs": 7, "ate_m": interval(1.0), "ratio_to_causal": interval(2.0), "nees_pose_per_dof": interval(3.0)}
    entry |= {"coverage_95": interval(0.9), "verdict": "right", "landmarks_mapped": None}
    estimators = {"ekf": entry, "a_b|c": entry | {"ate_m": None}}
    content = {"scenario": "my_scene", "runs": 7, "seed": 3, "command": "slamgauge study", "version": "1"}
    content |= {"digest": "", "failures": [], "per_run": {}}
    (tmp_path / "summary.json").write_text(json.dumps(content | {"estimators": estimators}), encoding="utf-8")
    return tmp_path


def test_each_format_and_missing_columns(study: Path):
    assert study_table(study, "csv", ["ate_m"], []).splitlines() == [
        "estimator,runs,ate_m,ate_m_low,ate_m_high",
        "ekf,7,1.0,0.5,1.5",
        "a_b|c,7,,,",
    ]
    assert study_table(study, "csv", ["ate_m"], ["ekf"], intervals=False) == "estimator,runs,ate_m\nekf,7,1.0\n"
    assert study_table(study, "markdown", ["ate_m", "nees_pose_per_dof"], []).splitlines() == [
        "| estimator | runs | ATE [m] | NEES/3 |",
        "| --- | ---: | ---: | ---: |",
        "| ekf | 7 | 1.000 ± 0.500 | 3.00 ± 0.50 |",
        r"| a_b\|c | 7 | - | 3.00 ± 0.50 |",
    ]
    latex = study_table(study, "latex", [], ["a_b|c"])
    assert r"\begin{tabular}{lrrrrr}" in latex
    assert all(f"\\{rule}rule" in latex for rule in ("top", "mid", "bottom"))
    assert r"\caption{my\_scene, 7 runs (seed 3), means with 95 \% intervals. ATE [m]: " in latex
    assert r"a\_b|c & 7 & - & 2.000 $\pm$ 0.500 & 3.00 $\pm$ 0.50 & 90.0\% $\pm$ 50.0\% \\" in latex
    assert r"$x^2$ & {~\}#".translate(LATEX) == r"\$x\textasciicircum{}2\$ \& \{\textasciitilde{}\textbackslash{}\}\#"
    for keys, names, message in (
        (["ate"], [], r"ate: no column of this study; did you mean ate_m\?"),
        (["verdict"], [], "verdict: no column"),  # it has no interval
        ([], ["efk"], r"efk: no estimator of this study; did you mean ekf\?"),
    ):
        with pytest.raises(UserError, match=message):
            study_table(study, "csv", keys, names)


def test_the_command_prints_or_writes_it(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["export", "markdown", str(study), "--columns", "ate_m", "--means-only"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[2] == "| ekf | 7 | 1.000 |"
    assert main([*arguments, "--out", str(tmp_path / "tables" / "ate.md")]) == 0
    assert (tmp_path / "tables" / "ate.md").read_text(encoding="utf-8").rstrip() == printed.rstrip()
    (study / "summary.json").write_text("[]", encoding="utf-8")
    assert main(arguments) == 2
    assert "summary.json: written by another version, or changed by hand" in capsys.readouterr().err
