"""Claims: the verdicts follow from the figures of the runs, and the settings behind them are what they say."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from held_by_schemas import held
from scipy.stats import ttest_1samp

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import claims as module
from slamgauge.compare.studies.claim_list import CLAIMS, SAME, SETTINGS, Claim, during, stored
from slamgauge.compare.studies.claims import ALPHA, Claims, claims_table, judge, weigh

ABOVE_ONE, BELOW_ONE, ALIKE = (1.0, math.inf), (0.0, 1.0), (1 / SAME, SAME)


def sample(mean: float, spread: float, runs: int = 50, seed: int = 0) -> Float:
    drawn = np.random.default_rng(seed).normal(size=runs)
    return mean + spread * (drawn - drawn.mean()) / drawn.std(ddof=1)


def runs_of(figures: dict[str, Float], numbers: list[int] | None = None) -> Runs:
    count = len(next(iter(figures.values())))
    figures = {"optimum_check_sigma": np.full(count, np.nan)} | figures
    return Runs(np.arange(count) if numbers is None else np.array(numbers), "filtered", figures, {})


def test_p_value_and_interval_are_students_corrected_for_the_number_of_claims():
    logs = np.random.default_rng(1).normal(0.1, 0.3, 40)
    evidence = weigh(logs, ABOVE_ONE, 19)
    reference = ttest_1samp(logs, 0.0)
    assert evidence.p_value == pytest.approx(min(1.0, 19 * reference.pvalue), rel=1e-9)  # pyright: ignore[reportAttributeAccessIssue]
    low, high = reference.confidence_interval(1 - ALPHA / 19)
    assert (evidence.low, evidence.high) == pytest.approx((math.exp(low), math.exp(high)))
    assert evidence.effect == pytest.approx(math.exp(logs.mean()))


@pytest.mark.parametrize(
    ("effect", "asserted", "verdict"),
    [
        (1.5, ABOVE_ONE, "holds"),
        (0.7, ABOVE_ONE, "does not hold"),
        (1.02, ABOVE_ONE, "undecided"),
        (0.7, BELOW_ONE, "holds"),
        (1.5, BELOW_ONE, "does not hold"),
        (1.0, ALIKE, "holds"),
        (1.5, ALIKE, "does not hold"),
        (0.6, ALIKE, "does not hold"),
        (SAME, ALIKE, "undecided"),
        (3.0, (2.0, math.inf), "holds"),
        (1.5, (2.0, math.inf), "does not hold"),
    ],
)
def test_verdicts(effect: float, asserted: tuple[float, float], verdict: str):
    evidence = weigh(sample(math.log(effect), 0.1), asserted, len(CLAIMS))
    assert evidence.verdict == verdict
    assert evidence.low is not None
    assert evidence.high is not None
    inside = asserted[0] < evidence.low and evidence.high < asserted[1]
    outside = evidence.high < asserted[0] or evidence.low > asserted[1]
    assert (inside, outside) == (verdict == "holds", verdict == "does not hold")  # the interval tells the same


def test_a_ratio_without_any_spread_is_decided_by_its_side_alone():
    assert weigh(np.full(5, 0.3), ABOVE_ONE, 19).verdict == "holds"
    assert weigh(np.full(5, -0.3), ABOVE_ONE, 19).verdict == "does not hold"
    assert weigh(np.zeros(5), ABOVE_ONE, 19).verdict == "undecided"


def test_too_few_runs_decide_nothing_and_overflow_is_no_number():
    assert weigh(np.zeros(1), ABOVE_ONE, 19).verdict == "undecided"
    evidence = weigh(np.array([0.0, 6.0]), ABOVE_ONE, 19)
    assert (evidence.high, evidence.verdict) == (None, "undecided")
    claim = CLAIMS[0]
    nobody = runs_of({"landmark_error_far_m": np.zeros(0), "landmark_error_near_m": np.zeros(0), "ate_m": np.zeros(0)})
    setting = claim.figure.setting
    judgement = judge(claim, {(setting, "ekf"): nobody, (setting, "isam2"): nobody}, 19)
    assert (judgement.optimum, judgement.evidence.effect, judgement.evidence.runs) == (None, None, 0)
    line = str(claims_table(Claims([judgement], ["there, run 0: ekf failed: no luck"]))).splitlines()
    assert "  undecided      -    - to -  1.0000          -     0  " in line[1]
    assert line[-1] == "there, run 0: ekf failed: no luck"
    json.dumps(judgement.to_json(), allow_nan=False)


def test_false_alarms_are_as_rare_as_stated():
    """Of 2000 samples without any effect, 19 tests in one, a share of 5 % / 19 is decided: 0.26 %, at most 14."""
    rng = np.random.default_rng(0)
    decided = [weigh(rng.normal(0.0, 0.4, 50), ABOVE_ONE, 19).verdict != "undecided" for _ in range(2000)]
    assert sum(decided) <= 14  # binomial, 99.9 %


def test_ratios_pair_the_runs_and_the_least_suitable_rival_decides():
    ones = np.ones(6)
    claim = Claim("c", "0", "best", "a / b, a / c < 1", stored("a", "x"), (stored("b", "x"), stored("c", "x")), (0, 1))
    wiggle = 1 + 0.01 * np.arange(6)
    studies = {
        ("a", "ekf"): runs_of({"x": ones * wiggle, "ate_m": 2 * ones}),
        ("b", "ekf"): runs_of({"x": 2 * ones}),
        ("c", "ekf"): runs_of({"x": np.array([3.0, 3.0, 0.5, 0.5])}, [10, 11, 0, 1]),  # only runs 0 and 1 are common
        ("a", "isam2"): runs_of({"ate_m": ones}),
    }
    judgement = judge(claim, studies, 1)
    assert judgement.evidence.effect == pytest.approx(math.sqrt(1.0 * 1.01) / 0.5)
    assert judgement.evidence.runs == 2
    assert judgement.evidence.verdict == "does not hold"
    assert judgement.optimum == pytest.approx(0.5)


def test_stretches_of_the_first_loop():
    steps = 200  # two loops of 100
    x = np.zeros((1, steps + 1))
    x[0, 45:56], x[0, 95:106] = 2.0, 3.0
    runs = Runs(np.array([0]), "filtered", {}, {"error_x": x, "error_y": np.zeros_like(x)})
    assert during("s", "error", 0.45, 0.55).read(runs) == pytest.approx(2.0)
    assert during("s", "error", 0.95, 1.05).read(runs) == pytest.approx(3.0)
    assert during("s", "error", 0.0, 0.1).read(runs) == 0.0


def test_every_claim_is_about_the_settings_and_named_once():
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS)
    used = {figure.setting for claim in CLAIMS for figure in (claim.figure, *claim.others)}
    assert used == set(SETTINGS)
    assert {claim.section for claim in CLAIMS} == {"2.1", "2.2", "3.1"}


@pytest.mark.parametrize(
    "family", [("q1-long-sparse", "q2-long-sparse", "q3-scale-10"), ("q2-gate-1", "q1-long-dense")]
)
def test_settings_that_are_compared_see_the_same_measurements(family: tuple[str, ...]):
    recordings = [simulate(informed(load_scenario(name)), 5)[1] for name in family]
    for other in recordings[1:]:
        np.testing.assert_array_equal(recordings[0].observation, other.observation)
        np.testing.assert_array_equal(recordings[0].odometry, other.odometry)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """On two settings and three runs; a second call runs nothing again and says the same."""
    few = [claim for claim in CLAIMS if claim.id in ("q1-sparse-error", "q1-sigma-grows")]
    settings = ("q1-long-dense", "q1-long-sparse")
    monkeypatch.setattr(module, "CLAIMS", few)
    monkeypatch.setattr(module, "SETTINGS", settings)
    arguments = ["claims", "--runs", "3", "--jobs", "1", "--out", str(tmp_path / "claims")]
    assert main(arguments) == 0
    table = capsys.readouterr().out
    assert table.splitlines()[0].split()[:3] == ["section", "the", "practical"]
    assert table.splitlines()[-1].startswith("2 claims: ")
    content = held("claims", json.loads((tmp_path / "claims/claims.json").read_text()))
    keys = {"id", "section", "claim", "hypothesis", "effect", "low", "high", "p_value", "verdict", "optimum"}
    assert all(keys <= set(entry) for entry in content)
    assert content[0]["verdict"] == "holds"  # sigma grows: hardly any spread

    monkeypatch.setattr("slamgauge.compare.studies.run.simulate_informed", None)  # nothing is simulated again
    assert main([*arguments, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again == [{**entry, "command": again[0]["command"]} for entry in content]
    assert again[0]["command"] == f"{content[0]['command']} --json"
    assert main(["claims", "--runs", "1", "--out", str(tmp_path / "other")]) == 2
    assert "give at least 2" in capsys.readouterr().err


def test_what_rests_on_an_optimum_in_doubt_is_marked():
    of_itself, of_optimum = (
        next(each for each in CLAIMS if each.id == f"q3-scale-{rest}") for rest in ("1-error", "0.1-error")
    )
    ate = {"ate_m": np.exp(sample(1.0, 0.01, 4))}
    optimum = {"ate_m": np.ones(4), "optimum_check_sigma": np.array([0.0, 0.05, 0.06, np.inf])}
    settings = ("q3-scale-0.1", "q3-scale-1")
    studies = {(setting, "ekf"): runs_of(ate) for setting in settings}
    studies |= {(setting, "isam2"): runs_of(optimum) for setting in settings}
    judged = [judge(claim, studies, 2) for claim in (of_itself, of_optimum)]
    lines = str(claims_table(Claims(judged, []))).splitlines()
    assert [line.count("?") for line in lines[1:3]] == [1, 3]  # avoidable; ratio and verdict too
    assert lines[-1] == (
        "q3-scale-1, q3-scale-0.1: isam2 is more than 0.05 sigma from the optimum of the whole recording "
        "in 50.0% of the runs: figures relative to it are marked ?"
    )
    assert [each.to_json()["optimum_check_share"] for each in judged] == [0.5, 0.5]


def test_table_shows_small_p_values_as_such():
    claim = CLAIMS[0]
    studies = {
        (claim.figure.setting, "ekf"): runs_of(
            {
                "landmark_error_far_m": np.exp(sample(1.0, 0.01)),
                "landmark_error_near_m": np.ones(50),
                "ate_m": np.full(50, 2.0),
            }
        ),
        (claim.figure.setting, "isam2"): runs_of({"ate_m": np.ones(50)}),
    }
    line = str(claims_table(Claims([judge(claim, studies, 19)], []))).splitlines()[1]
    assert "< 0.0001" in line
    assert "holds" in line
    assert "  < 0.0001        50%    50  " in line
