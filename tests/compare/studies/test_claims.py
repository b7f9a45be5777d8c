"""Claims: verdicts follow from the figures of the runs, and settings simulate the same where they should."""

from __future__ import annotations

import json
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.confidence_sequence import log_wealth, lower_end, smallest_effect, upper_end
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.studies import claims as module
from slamgauge.compare.studies.claim_evidence import ALPHA, Evidence
from slamgauge.compare.studies.claim_evidence import weigh as weigh_for
from slamgauge.compare.studies.claim_list import CLAIMS, SAME, SETTINGS, Claim, ClaimSet, during, stored
from slamgauge.compare.studies.claims import (
    Claims,
    Judgement,
    Look,
    claims_table,
    judge,
    judge_claims,
    scenarios_of_settings,
)
from slamgauge.compare.studies.literature_claims import LITERATURE, SOURCES
from slamgauge.compare.studies.summary import Summary
from tests.reference.json_schemas import held

ABOVE_ONE, BELOW_ONE, ALIKE = (1.0, math.inf), (0.0, 1.0), (1 / SAME, SAME)


def sample(mean: float, spread: float, runs: int = 50, seed: int = 0) -> Float:
    drawn = np.random.default_rng(seed).normal(size=runs)
    return mean + spread * (drawn - drawn.mean()) / drawn.std(ddof=1)


def runs_of(figures: dict[str, Float], numbers: list[int] | None = None) -> Runs:
    count = len(next(iter(figures.values())))
    figures = {"optimum_check_sigma": np.full(count, np.nan)} | figures
    return Runs(np.arange(count) if numbers is None else np.array(numbers), "filtered", figures, {})


def weigh(log_ratios: Float, asserted: tuple[float, float], tests: int) -> Evidence:
    """Return the evidence for one of several ratios after the last run."""
    figure = stored("a", "x")
    return weigh_for(log_ratios, Claim("c", "", "", figure, (figure,), asserted), tests, len(log_ratios))


def judged(claim: Claim, studies: dict[tuple[str, str], Runs]) -> Judgement:
    def load(setting: str, estimator: str, _: int) -> Runs:
        return studies[setting, estimator]

    return judge(claim, load, Look(50, 50, len(CLAIMS)), load_scenario("q1-short-dense"), 0)


def table(judgements: list[Judgement], failures: list[str]) -> list[str]:
    return str(claims_table(Claims(judgements, failures))).splitlines()


def test_p_value_and_interval_are_those_of_bets_corrected_for_the_number_of_claims():
    logs, limit = np.random.default_rng(1).normal(0.1, 0.3, 400), math.log(10.0)
    evidence = weigh(logs, ABOVE_ONE, 19)
    assert 1e-9 < evidence.p_value < 1.0
    assert evidence.p_value == pytest.approx(2 * 19 * math.exp(-log_wealth(logs, limit)))
    ends = [end(logs, limit, math.log(2 * 19 / ALPHA)) for end in (lower_end, upper_end)]
    assert (evidence.low, evidence.high) == pytest.approx(tuple(np.exp(ends)))
    assert evidence.effect == pytest.approx(math.exp(logs.mean()))
    assert weigh(-logs, BELOW_ONE, 19).p_value == pytest.approx(evidence.p_value)
    needed = smallest_effect(logs, limit, math.log(2 * 19 / ALPHA), 400)
    assert evidence.decidable == pytest.approx(math.exp(needed))


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
    evidence = weigh(sample(math.log(effect), 0.1, runs=400), asserted, len(CLAIMS))
    assert evidence.verdict == verdict
    assert evidence.low is not None
    assert evidence.high is not None
    inside = asserted[0] < evidence.low and evidence.high < asserted[1]
    outside = evidence.high < asserted[0] or evidence.low > asserted[1]
    assert (inside, outside) == (verdict == "holds", verdict == "does not hold")


@pytest.mark.parametrize(("logarithm", "verdict"), [(0.3, "holds"), (-0.3, "does not hold"), (0.0, "undecided")])
def test_a_ratio_without_spread_is_decided_by_its_side(logarithm: float, verdict: str):
    assert weigh(np.full(100, logarithm), ABOVE_ONE, 19).verdict == verdict


def test_too_few_runs_are_undecided_and_overflow_is_none():
    assert weigh(np.zeros(1), ABOVE_ONE, 19).verdict == "undecided"
    evidence = weigh(np.array([0.0, 6.0]), ABOVE_ONE, 19)
    assert (evidence.low, evidence.high, evidence.decidable, evidence.verdict) == (None, None, None, "undecided")
    assert weigh(np.full(50, 800.0), ABOVE_ONE, 19).effect is None
    claim = CLAIMS[0]
    nobody = runs_of({"landmark_error_far_m": np.zeros(0), "landmark_error_near_m": np.zeros(0), "ate_m": np.zeros(0)})
    setting = claim.figure.setting
    judgement = judged(claim, {(setting, "ekf"): nobody, (setting, "causal"): nobody})
    assert (judgement.optimum, judgement.evidence.effect, judgement.evidence.runs) == (None, None, 0)
    line = table([judgement], ["there, run 0: ekf failed: broken on purpose"])
    assert "  undecided      -    - to -  1.0000          -     0          -  " in line[1]
    assert line[-1] == "there, run 0: ekf failed: broken on purpose"
    json.dumps(judgement.to_json(), allow_nan=False)


def test_false_alarms_are_at_most_as_frequent_as_stated():
    """At most 5 % of 150 samples without effect are decided: 17 (binomial, 99.9 %). One run in ten is an outlier."""
    lost = np.random.default_rng(0).random((150, 100)) < 0.1
    decided = [weigh(np.where(each, -0.9, 0.1), ABOVE_ONE, 1).verdict != "undecided" for each in lost]
    assert sum(decided) <= 17


def test_ratios_pair_the_runs_and_the_least_favourable_denominator_decides():
    ones = np.ones(6)
    claim = Claim("c", "best", "a / b, a / c < 1", stored("a", "x"), (stored("b", "x"), stored("c", "x")), (0, 1))
    wiggle = 1 + 0.01 * np.arange(6)
    studies = {
        ("a", "ekf"): runs_of({"x": ones * wiggle, "ate_m": 2 * ones}),
        ("b", "ekf"): runs_of({"x": 2 * ones}),
        ("c", "ekf"): runs_of({"x": np.array([3.0, 3.0, 0.5, 0.5])}, [10, 11, 0, 1]),  # only runs 0 and 1 are common
        ("a", "causal"): runs_of({"ate_m": ones}),
    }
    judgement = judged(claim, studies)
    assert judgement.evidence.effect == pytest.approx(math.sqrt(1.0 * 1.01) / 0.5)
    assert judgement.evidence.runs == 2
    assert judgement.evidence.support < 0.0
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
    used = {figure.setting for claim in CLAIMS for figure in claim.compared}
    assert used == set(SETTINGS)
    assert {claim.section for claim in CLAIMS} == {"2.1", "2.2", "3.1"}


def test_claims_of_the_literature_have_sources_and_known_settings():
    claims = LITERATURE.claims
    assert len({claim.id for claim in claims}) == len(claims) >= 15
    assert {figure.setting for claim in claims for figure in claim.compared} == set(LITERATURE.settings)
    assert {claim.section for claim in claims} == set(SOURCES)
    assert {claim.source for claim in claims} == set(SOURCES.values())
    assert set(scenarios_of_settings(LITERATURE.settings)) == set(LITERATURE.settings)


@pytest.mark.usefixtures("studies_in_a_thread")
def test_every_claim_of_the_literature_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two runs of 20 steps: every figure is defined, and two runs decide nothing."""
    scenarios = scenarios_of_settings(LITERATURE.settings)
    short = {name: [f"trajectory.duration={20 * each.trajectory.step}"] for name, each in scenarios.items()}
    settings = {name: (*each, *short[name]) for name, each in LITERATURE.settings.items()}
    monkeypatch.setitem(module.SETS, "literature", ClaimSet(settings, LITERATURE.claims))
    with ThreadPoolExecutor(1) as executor:
        claims = judge_claims(2, 0, tmp_path, executor, of="literature")
    assert not claims.failures
    assert {each.evidence.runs for each in claims.judgements} == {2}
    assert {each.evidence.verdict for each in claims.judgements} == {"undecided"}
    page = str(claims_table(claims))
    assert all(source.split(",")[0] in page for source in SOURCES.values())


def test_settings_that_are_compared_share_their_random_numbers():
    """Compared settings have the same start and odometry; with the same map also the same observations."""
    pairs = {(claim.figure.setting, other.setting) for claim in CLAIMS for other in claim.others}
    scenarios = {name: informed(load_scenario(name, ["start=sampled"])) for name in SETTINGS}
    runs = {name: simulate(scenario, 5) for name, scenario in scenarios.items()}
    seen_alike = 0
    for one, two in pairs:
        np.testing.assert_array_equal(runs[one][0].poses, runs[two][0].poses)
        np.testing.assert_array_equal(runs[one][1].odometry, runs[two][1].odometry)
        if scenarios[one] == scenarios[two]:
            np.testing.assert_array_equal(runs[one][1].observation, runs[two][1].observation)
            seen_alike += 1
    assert seen_alike == len(pairs) - 1  # all but the sparse map and the dense one


def test_claims_continue_until_they_are_decided(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One is decided at once, one after 153 runs, one never; no study has more runs than requested."""
    margins = {"b": 1.2, "c": 0.15, "d": 0.0}  # logarithms of a's figure divided by theirs
    requested: dict[str, list[int]] = {}

    def run(scenario: Scenario, runs: int, *_: object) -> Summary:
        requested.setdefault(scenario.name, []).append(runs)
        return Summary(scenario.name, runs, 0, "", (), {})

    def load(scenario: Scenario, runs: int, _: int, names: list[str], __: Path) -> dict[str, Runs]:
        figures = {"x": np.exp(-margins.get(scenario.name, 0.0) * np.ones(runs)), "ate_m": np.ones(runs)}
        return {names[0]: runs_of(figures)}

    kept = load_scenario("q1-long-dense")
    scenarios = {name: kept.model_copy(update={"name": name}) for name in "abcd"}
    claims = [Claim(each, "", "", stored("a", "x"), (stored(each, "x"),), ABOVE_ONE) for each in "bcd"]
    monkeypatch.setitem(module.SETS, "exercise", ClaimSet({}, tuple(claims)))

    def settings_of(_: object) -> dict[str, Scenario]:
        return scenarios

    monkeypatch.setattr(module, "scenarios_of_settings", settings_of)
    monkeypatch.setattr("slamgauge.compare.studies.claims.run_study", run)
    monkeypatch.setattr("slamgauge.compare.studies.claims.load_runs", load)
    with ThreadPoolExecutor(1) as executor:
        found = judge_claims(20, 0, tmp_path, executor, most=300).judgements
        once = judge_claims(20, 0, tmp_path, executor).judgements
    expected = [("holds", 20), ("holds", 153), ("undecided", 300)]
    assert [(each.evidence.verdict, each.evidence.runs) for each in found] == expected
    assert requested["b"][0] == 20
    assert requested["c"][:6] == [20, 30, 45, 68, 102, 153]
    assert requested["d"][:8] == [20, 30, 45, 68, 102, 153, 230, 300]
    assert requested["optimum"] == [20, 20]  # the first look only, in either call
    assert [each.evidence.verdict for each in once] == ["holds", "undecided", "undecided"]


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Two settings of 30 s, three runs; a second call repeats no run and prints the same."""

    few = tuple(claim for claim in CLAIMS if claim.id in ("q1-sparse-error", "q1-sigma-grows"))
    settings: dict[str, tuple[str, ...]] = {
        name: (name, "trajectory.duration=30") for name in ("q1-long-dense", "q1-long-sparse")
    }
    monkeypatch.setitem(module.SETS, "exercise", ClaimSet(settings, few))
    arguments = ["claims", "--runs", "2", "--max-runs", "3", "--jobs", "1", "--out", str(tmp_path / "claims")]
    assert main(arguments) == 0
    table = capsys.readouterr().out
    assert table.splitlines()[0].split()[:3] == ["section", "the", "exercise"]
    assert table.splitlines()[-2].startswith("2 claims: ")
    content = held("claims", json.loads((tmp_path / "claims/claims.json").read_text()))
    keys = {"id", "section", "claim", "hypothesis", "effect", "low", "high", "p_value", "verdict", "optimum"}
    assert all(keys <= set(entry) for entry in content)
    assert {entry["verdict"] for entry in content} == {"undecided"}  # three runs are too few
    assert {entry["runs"] for entry in content} == {3}
    assert all(entry["scenario_text"] for entry in content)

    monkeypatch.setattr("slamgauge.compare.studies.study_run.simulate_informed", None)  # nothing is simulated again
    assert main([*arguments, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again == [{**entry, "command": again[0]["command"]} for entry in content]
    assert again[0]["command"] == f"{content[0]['command']} --json"
    bad = {"--runs=1": "give at least 2", "--max-runs=-5": "max-runs: -5 is less than the"}
    for option, message in bad.items():
        assert main(["claims", option, "--out", str(tmp_path / "other")]) == 2
        assert message in capsys.readouterr().err


def test_figures_of_an_optimum_in_doubt_are_marked():
    of_itself, of_optimum = (
        next(each for each in CLAIMS if each.id == f"q3-scale-{rest}") for rest in ("1-error", "0.1-error")
    )
    ate = {"ate_m": np.exp(sample(1.0, 0.01, 4))}
    optimum = {"ate_m": np.ones(4), "optimum_check_sigma": np.array([0.0, 0.05, 0.06, np.inf])}
    settings = ("q3-scale-0.1", "q3-scale-1")
    studies = {(setting, "ekf"): runs_of(ate) for setting in settings}
    studies |= {(setting, "causal"): runs_of(optimum) for setting in settings}
    both = [judged(claim, studies) for claim in (of_itself, of_optimum)]
    lines = table(both, [])
    assert [line.count("?") for line in lines[1:3]] == [1, 3]  # avoidable; ratio and verdict too
    assert lines[-1] == (
        "q3-scale-1, q3-scale-0.1: causal is more than 0.05 sigma from the optimum at a checked step "
        "in 50.0% of the runs: figures relative to it are marked ?"
    )
    assert [each.to_json()["optimum_check_share"] for each in both] == [0.5, 0.5]


def test_table_shows_small_p_values_as_such():
    claim = CLAIMS[0]
    figures = {"landmark_error_far_m": np.exp(sample(1.0, 0.01)), "landmark_error_near_m": np.ones(50)}
    ekf, causal = runs_of(figures | {"ate_m": np.full(50, 2.0)}), runs_of({"ate_m": np.ones(50)})
    setting = claim.figure.setting
    line = table([judged(claim, {(setting, "ekf"): ekf, (setting, "causal"): causal})], [])[1]
    assert "< 0.0001" in line
    assert "holds" in line
    assert "  < 0.0001        50%    50  " in line
