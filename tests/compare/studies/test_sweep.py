"""Sweeps: a study at each value, one optimum for all values with the same measurements, and a figure."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.studies.summary import EstimatorSummary, Summary
from slamgauge.compare.studies.sweep import Sweep, run_sweep, split_sweep, sweep_table
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate

pytestmark = pytest.mark.slow

SHORT = ["start=sampled", "trajectory.duration=3"]
BOTH = ("ekf", "causal")
Swept = Callable[..., Sweep]


@pytest.fixture
def swept(thread: ThreadPoolExecutor, tmp_path: Path) -> Swept:
    def swept(scenario: str, sweep: str, runs: int, names: tuple[str, ...] = BOTH, seed: int = 0) -> Sweep:
        return run_sweep(scenario, SHORT, sweep, runs, seed, names, tmp_path, thread)

    return swept


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            ["prior.mean=[0,0,0],[1,0,0]", "description=a/b", "a={b=1}"],
            "cannot be swept; write a scenario file for each",
        ),
        (["association.gate", "=1,2", "association.gate=", "association.gate= , "], r"write key=v1,v2,\.\.\."),
        (["a.b=1,2,1"], "name each once"),
    ],
)
def test_texts_that_are_no_sweep_are_refused(texts: list[str], message: str):
    for text in texts:
        with pytest.raises(UserError, match=message):
            split_sweep(text)
    assert split_sweep("a.b = 1, x ,2.5") == ("a.b", ("1", "x", "2.5"))


def test_every_point_is_the_study_of_its_scenario_and_the_optimum_runs_once(
    swept: Swept, run: Callable[..., Summary], tmp_path: Path
):
    sweep = swept("q2-long-dense", "association.gate=1,9", 3, seed=5)
    assert sweep.values == ("1", "9")
    for value, summary in zip(sweep.values, sweep.summaries, strict=True):
        scenario = load_scenario("q2-long-dense", [*SHORT, f"association.gate={value}"])
        alone = run(3, BOTH, value, seed=5, scenario=scenario)
        for name in BOTH:
            one, other = summary.estimators[name], alone.estimators[name]
            assert (one["ate_m"], one["landmarks_mapped"]) == (other["ate_m"], other["landmarks_mapped"])
        assert summary.estimators["ekf"]["ratio_to_causal"] == alone.estimators["ekf"]["ratio_to_causal"]
    assert len(list((tmp_path / "optimum").iterdir())) == 1
    assert sweep.summaries[0].estimators["causal"]["ate_m"] == sweep.summaries[1].estimators["causal"]["ate_m"]
    mapped = [summary.estimators["ekf"]["landmarks_mapped"] for summary in sweep.summaries]
    assert mapped[0].mean > 2 * mapped[1].mean


def test_a_key_that_changes_the_measurements_has_an_optimum_at_each_value(swept: Swept, tmp_path: Path):
    sweep = swept("q1-long-dense", "sensor.sigma_range=0.01,1", 2)
    assert len(list((tmp_path / "optimum").iterdir())) == 2
    first, second = (summary.estimators["causal"]["ate_m"].mean for summary in sweep.summaries)
    assert first < second


@pytest.mark.parametrize(("scenario", "has_effect"), [("q1-long-dense", False), ("q2-long-dense", True)])
def test_a_sweep_names_a_key_without_effect(swept: Swept, scenario: str, has_effect: bool):
    """A gate has no effect with known association."""
    sweep = swept(scenario, "association.gate=1,9", 2)
    line = "association.gate has no effect on ekf: the same figures at every value"
    assert str(sweep_table(sweep)).splitlines().count(line) == sweep.to_json()["notes"].count(line) == (not has_effect)


def test_more_values_later_run_no_optimum_again_and_failures_are_reported(
    swept: Swept, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: object, **__: object) -> Estimate:
        raise UserError("broken on purpose")

    swept("q2-long-dense", "association.gate=9,16", 2)
    monkeypatch.setattr("slamgauge.graph_baseline.causal", broken)
    monkeypatch.setattr("slamgauge.ekf.ekf_slam", broken)
    again = swept("q2-long-dense", "association.gate=4,9", 2)
    assert again.summaries[0].estimators["causal"]["runs"] == 2
    assert [failure.run for failure in again.summaries[0].failures] == [0, 1]
    assert again.summaries[1].failures == ()
    lines = str(sweep_table(again)).splitlines()
    assert lines[-1] == "association.gate=4, run 1: ekf failed: estimator ekf: broken on purpose"


@pytest.mark.parametrize(
    ("values", "name", "message"),
    [
        ("9,-1", "ekf", "choose it above 0"),
        ("9,9.0", "ekf", r"9 and 9\.0 are the same value"),
        ("9", "causal", "add a filter"),
    ],
)
def test_mistakes_are_found_before_anything_is_run(swept: Swept, tmp_path: Path, values: str, name: str, message: str):
    with pytest.raises(UserError, match=message):
        swept("q2-long-dense", f"association.gate={values}", 1, (name,))
    assert not list(tmp_path.iterdir())


def entry(summary: Summary, *faults: str, runs: int = 7) -> EstimatorSummary:
    return EstimatorSummary({**summary.estimators["ekf"], "runs": runs, "faults": faults})


def test_faults_are_below_the_table_with_their_values(swept: Swept):
    """They are those of the verdicts, without sizes, which the table has."""
    sweep = swept("q2-long-dense", "association.gate=1,4,9", 2, ("ekf",))
    small, loses = "claims too small a sigma", "worse than the causal optimum"
    faults = {
        "ekf": ((small, loses), (small,), (small,)),
        "mine": ((), (), ("claims too large a sigma",)),
        "right": ((), (), ()),
    }
    summaries = tuple(
        replace(each, estimators={name: entry(each, *found[place]) for name, found in faults.items()})
        for place, each in enumerate(sweep.summaries)
    )
    assert str(sweep_table(replace(sweep, runs=7, summaries=summaries))).splitlines()[-4:] == [
        "Empty columns: x causal (docs/your_filter.md lists what each needs)",
        "ekf: claims too small a sigma at every value; worse than the causal optimum at association.gate=1",
        "mine: claims too large a sigma at association.gate=9",
        "right: nothing wrong is shown by 7 runs",
    ]
    failed = tuple(replace(each, estimators={"mine": entry(each, runs=0)}) for each in sweep.summaries)
    assert "mine:" not in str(sweep_table(replace(sweep, summaries=failed)))


def test_the_command_sweeps_user_code_with_the_built_in_estimators(
    tmp_path: Path, drawn: dict[str, Figure], capsys: pytest.CaptureFixture[str]
):
    own = Path(__file__).parents[3] / "examples/student_ekf.py"
    arguments = ["study", "q3-scale-1", "--runs", "2", "--jobs", "1", "--set", "trajectory.duration=2"]
    arguments += ["--estimators", f"causal@ekf,ekf,mine={own}:ekf_slam,causal", "--out", str(tmp_path)]
    assert main([*arguments, "--sweep", "assumed.scale=0.1,10"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["assumed.scale", "estimator"]
    names = ("causal@ekf", "ekf", "mine", "causal")
    assert [line.split()[:2] for line in lines[1:9]] == [[value, name] for value in ("0.1", "10") for name in names]
    content = json.loads((tmp_path / "sweep.json").read_text())
    entries = [point["summary"]["estimators"]["ekf"] for point in content["points"]]
    expected = [["innovations larger than it expects"], ["innovations smaller than it expects"]]
    assert [each["faults"] for each in entries] == expected
    assert entries[1]["position_sigma_m"]["mean"] > entries[0]["position_sigma_m"]["mean"]
    assert drawn["sweep"].axes[0].get_legend_handles_labels()[1] == ["causal@ekf", "ekf", "mine", "causal optimum"]
    assert (tmp_path / "assumed.scale=0.1/summary.json").exists()
