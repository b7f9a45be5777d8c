"""Claims of the literature: the data file agrees with itself, every claim runs, and verdicts are rarely wrong."""

from __future__ import annotations

import math
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from literature import FIGURES, FILE, Claim, log_ratios, simulated, verdict
from scipy import stats

from slamgauge import load_scenario

pytestmark = pytest.mark.slow

CONTENT = tomllib.loads(FILE.read_text(encoding="utf-8"))
CLAIMS = [Claim(**each) for each in CONTENT["claims"]]
ALIKE = (1 / 1.1, 1.1)


def test_claims_have_sources_settings_and_figures():
    assert len({each.id for each in CLAIMS}) == len(CLAIMS)
    assert {each.id.partition("-")[0] for each in CLAIMS} == CONTENT["sources"].keys()
    assert {setting for each in CLAIMS for setting, _ in each.compared()} == CONTENT["settings"].keys()
    assert {each.figure for each in CLAIMS} == FIGURES.keys()
    assert all(low < high for each in CLAIMS for low, high in [each.range])


@pytest.mark.full  # ten studies
def test_every_claim_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Two runs of 20 steps of each setting: every ratio is defined in both."""
    short: dict[str, list[str]] = {}
    for name, (scenario, *overrides) in CONTENT["settings"].items():
        step = load_scenario(scenario, overrides).trajectory.step
        short[name] = [scenario, *overrides, f"trajectory.duration={20 * step}"]
    monkeypatch.setattr("literature.local_processes", ThreadPoolExecutor)
    found = simulated(CLAIMS, short, 2, 0, 1, tmp_path)
    assert [len(log_ratios(each, found)) for each in CLAIMS] == [2] * len(CLAIMS)


@pytest.mark.parametrize(
    ("ratio", "asserted", "expected"),
    [
        (1.5, (1.0, math.inf), "holds"),
        (0.7, (1.0, math.inf), "does not hold"),
        (1.02, (1.0, math.inf), "undecided"),
        (0.7, (0.0, 1.0), "holds"),
        (1.0, ALIKE, "holds"),
        (0.6, ALIKE, "does not hold"),
        (1.1, ALIKE, "undecided"),
    ],
)
def test_verdicts(ratio: float, asserted: tuple[float, float], expected: str):
    drawn = np.random.default_rng(0).normal(size=100)
    logs = math.log(ratio) + 0.1 * (drawn - drawn.mean())
    result, found, low, high = verdict(logs, asserted, 27)
    assert result == expected
    assert low < found < high
    assert found == pytest.approx(ratio)
    wide = stats.t.interval(1 - 0.05 / 27, 99, logs.mean(), stats.sem(logs))
    assert (low, high) == pytest.approx(tuple(np.exp(wide)))
    assert verdict(logs[:1], asserted, 27)[0] == "undecided"


def test_a_wrong_verdict_on_any_of_all_claims_is_as_rare_as_stated():
    """Of 1000 sets of 27 ratios at the end of their range at most 5 % have a verdict (99.9 % binomial bounds)."""
    rng, trials, tests = np.random.default_rng(0), 1000, 27
    logs = rng.normal(0.0, 0.3, (trials, tests, 40))
    wrong = sum(any(verdict(each, (1.0, math.inf), tests)[0] != "undecided" for each in one) for one in logs)
    low, high = stats.binom.interval(0.999, trials, 0.05)
    assert low <= wrong <= high
