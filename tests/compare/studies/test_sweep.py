"""Sweeps: a study at each value, one optimum for all that see the same, and a figure."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import ScenarioError, load_scenario
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.summary import EstimatorSummary, Summary
from slamgauge.compare.studies.sweep import run_sweep, split_sweep, sweep_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from tests.reference.json_schemas import held

SHORT = ["start=sampled", "trajectory.duration=3"]


@pytest.mark.parametrize("text", ["prior.mean=[0,0,0],[1,0,0]", "description=a/b", "a={b=1}"])
def test_what_cannot_be_swept(text: str):
    with pytest.raises(ValueError, match="cannot be swept; write a scenario file for each"):
        split_sweep(text)


@pytest.mark.parametrize("text", ["association.gate", "=1,2", "association.gate=", "association.gate= , "])
def test_what_is_no_sweep(text: str):
    with pytest.raises(ValueError, match=r"write key=v1,v2,\.\.\."):
        split_sweep(text)


def test_a_value_twice():
    with pytest.raises(ValueError, match="name each once"):
        split_sweep("a.b=1,2,1")
    assert split_sweep("a.b = 1, x ,2.5") == ("a.b", ("1", "x", "2.5"))


def test_every_point_is_the_study_of_its_scenario_and_the_optimum_runs_once(tmp_path: Path):
    with ThreadPoolExecutor(1) as executor:
        sweep = run_sweep(
            "q2-long-dense", SHORT, "association.gate=1,9", 3, 5, ["ekf", "causal"], tmp_path / "sweep", executor
        )
        assert sweep.values == ("1", "9")
        for value, summary in zip(sweep.values, sweep.summaries, strict=True):
            scenario = load_scenario("q2-long-dense", [*SHORT, f"association.gate={value}"])
            alone = run_study(scenario, 3, 5, ["ekf", "causal"], tmp_path / value, executor)
            for name in ("ekf", "causal"):
                one, other = summary.estimators[name], alone.estimators[name]
                assert (one.ate_m, one.landmarks_mapped) == (other.ate_m, other.landmarks_mapped)
            assert summary.estimators["ekf"].ratio_to_causal == alone.estimators["ekf"].ratio_to_causal
    assert len(list((tmp_path / "sweep/optimum").iterdir())) == 1
    assert sweep.summaries[0].estimators["causal"].ate_m == sweep.summaries[1].estimators["causal"].ate_m
    mapped = [summary.estimators["ekf"].landmarks_mapped for summary in sweep.summaries]
    assert mapped[0] is not None
    assert mapped[1] is not None
    assert mapped[0].mean > 2 * mapped[1].mean


def test_a_key_that_changes_the_measurements_has_an_optimum_at_each_value(tmp_path: Path):
    with ThreadPoolExecutor(1) as executor:
        sweep = run_sweep(
            "q1-long-dense", SHORT, "sensor.sigma_range=0.01,1", 2, 0, ["ekf", "causal"], tmp_path, executor
        )
    assert len(list((tmp_path / "optimum").iterdir())) == 2
    first, second = (summary.estimators["causal"].ate_m for summary in sweep.summaries)
    assert first is not None
    assert second is not None
    assert first.mean < second.mean


def test_more_values_later_run_no_optimum_again_and_failures_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    sweep = ("q2-long-dense", SHORT, "association.gate=9,16", 2, 0, ["ekf", "causal"], tmp_path)
    with ThreadPoolExecutor(1) as executor:
        run_sweep(*sweep, executor)

        def broken(*_: object, **__: object) -> Estimate:
            raise UserError("no luck")

        monkeypatch.setattr("slamgauge.graph_baseline.causal", broken)
        monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
        again = run_sweep("q2-long-dense", SHORT, "association.gate=4,9", 2, 0, ["ekf", "causal"], tmp_path, executor)
    assert again.summaries[0].estimators["causal"].runs == 2
    assert [failure.run for failure in again.summaries[0].failures] == [0, 1]
    assert again.summaries[1].failures == ()
    lines = str(sweep_table(again)).splitlines()
    assert lines[-1] == "association.gate=4, run 1: ekf failed: estimator ekf: no luck"


def test_mistakes_are_found_before_anything_is_run(tmp_path: Path):
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(ScenarioError, match="choose it above 0"):
            run_sweep("q2-long-dense", SHORT, "association.gate=9,-1", 1, 0, ["ekf"], tmp_path, executor)
        with pytest.raises(ValueError, match=r"9 and 9\.0 are the same value"):
            run_sweep("q2-long-dense", SHORT, "association.gate=9,9.0", 1, 0, ["ekf"], tmp_path, executor)
        with pytest.raises(ValueError, match="add a filter"):
            run_sweep("q2-long-dense", SHORT, "association.gate=9", 1, 0, ["causal"], tmp_path, executor)
    assert not list(tmp_path.iterdir())


def test_a_filter_of_ones_own_is_swept_and_drawn_beside_ours(
    tmp_path: Path, saved: dict[str, Figure], capsys: pytest.CaptureFixture[str]
):
    own = Path(__file__).parents[3] / "examples/student_ekf.py"
    estimators = f"causal@ekf,mine={own}:ekf_slam,causal"
    arguments = ("study", "q2-long-dense", "--runs", "2", "--jobs", "1", "--estimators", estimators)
    sweep = ("--sweep", "association.gate=4,9", "--set", "trajectory.duration=3", "--out", str(tmp_path))
    assert main([*arguments, *sweep]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines[1:7]] == ["causal@ekf", "mine", "causal"] * 2
    titles = saved["sweep"].axes[0].get_legend_handles_labels()[1]
    assert titles == ["causal@ekf", "mine", "causal optimum"]


def entry(summary: Summary, *faults: str, runs: int = 7) -> EstimatorSummary:
    return replace(summary.estimators["ekf"], runs=runs, faults=faults)


def test_below_the_table_stands_what_is_wrong_and_at_which_values(tmp_path: Path):
    """What a verdict says at each value, without its sizes, which the table has."""
    with ThreadPoolExecutor(1) as executor:
        sweep = run_sweep("q2-long-dense", SHORT, "association.gate=1,4,9", 2, 0, ["ekf"], tmp_path, executor)
    said = {
        "ekf": (
            ("claims too small a sigma", "loses to the causal optimum"),
            ("claims too small a sigma",),
            ("claims too small a sigma",),
        ),
        "mine": ((), (), ("claims too large a sigma",)),
        "right": ((), (), ()),
    }
    summaries = tuple(
        replace(each, estimators={name: entry(each, *faults[place]) for name, faults in said.items()})
        for place, each in enumerate(sweep.summaries)
    )
    assert str(sweep_table(replace(sweep, runs=7, summaries=summaries))).splitlines()[-4:] == [
        "empty: x causal (docs/your_filter.md has what each column needs)",
        "ekf: claims too small a sigma at every value; loses to the causal optimum at association.gate=1",
        "mine: claims too large a sigma at association.gate=9",
        "right: nothing wrong is shown by 7 runs",
    ]
    failed = tuple(replace(each, estimators={"mine": entry(each, runs=0)}) for each in sweep.summaries)
    assert "mine:" not in str(sweep_table(replace(sweep, summaries=failed)))


@pytest.mark.usefixtures("studies_in_a_thread")
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ("study", "q3-scale-1", "--runs", "2", "--jobs", "1", "--estimators", "ekf,causal")
    sweep = ("--sweep", "assumed.scale=0.1,10", "--set", "trajectory.duration=2", "--out", str(tmp_path))
    assert main([*arguments, *sweep]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["assumed.scale", "estimator"]
    assert [line.split()[:2] for line in lines[1:5]] == [[v, e] for v in ("0.1", "10") for e in ("ekf", "causal")]
    assert [line.partition(":")[0] for line in lines[5:]] == ["ekf", "causal"]  # and no empty column
    content = held("sweep", json.loads((tmp_path / "sweep.json").read_text()))
    assert [point["value"] for point in content["points"]] == ["0.1", "10"]
    faults = [point["summary"]["estimators"]["ekf"]["faults"] for point in content["points"]]
    assert faults == [["innovations larger than it expects"], ["innovations smaller than it expects"]]
    sigma = [point["summary"]["estimators"]["ekf"]["position_sigma_m"]["mean"] for point in content["points"]]
    assert sigma[1] > sigma[0]
    assert imread(tmp_path / "sweep.png").shape == (1000, 1400, 4)
    assert (tmp_path / "assumed.scale=0.1/summary.json").exists()
