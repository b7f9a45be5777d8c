"""The practical's conclusions, put to the test over Monte Carlo runs.

A claim asserts that a ratio of two figures of the same run lies in a range. Over runs the logarithm of the
ratio has a mean, which Student's distribution bounds; the effect is the geometric mean of the ratios. The claim
holds when the effect lies in the range and the range's nearest end is rejected at 5 %, does not hold when the
effect lies outside and that end is rejected, and is undecided otherwise. p-values and intervals are corrected
for the number of claims (Bonferroni). Settings that simulate the same see the same measurements, run by run.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compare.claim_list import CLAIMS, FILTER, OPTIMUM, SETTINGS, Claim, Figure, ate
from compare.scenario import Scenario, load_scenario
from compare.simulation import informed
from compare.study import load_runs, run_study
from compare.study_store import Runs
from compare.study_summary import paired
from compare.text_table import aligned
from slam2d import Float

ALPHA = 0.05
Studies = Mapping[tuple[str, str], Runs]  # by setting and estimator


class Evidence(NamedTuple):
    """What the runs say of one ratio.

    Attributes:
        effect: its geometric mean over runs.
        low: lower end of its interval, corrected for the number of claims.
        high: upper end.
        p_value: of the asserted range's nearest end, two-sided, corrected.
        support: Student's statistic of that end, positive where the effect lies inside the range.
        runs: how many had both figures.
    """

    effect: float
    low: float
    high: float
    p_value: float
    support: float
    runs: int

    @property
    def verdict(self) -> str:
        """`holds`, `does not hold` or `undecided`."""
        if not self.p_value < ALPHA:
            return "undecided"
        return "holds" if self.support > 0 else "does not hold"


@dataclass(frozen=True)
class Judgement:
    """The evidence for a claim, and what the optimum says of its setting.

    `optimum` is the share of the filter's error there that the causal optimum avoids, which is told true noise and
    associations (1 - geometric mean over runs of its ATE over the filter's).
    """

    claim: Claim
    evidence: Evidence
    optimum: float

    def to_json(self) -> dict[str, Any]:
        """The claim's entry in claims.json."""
        claim, evidence = self.claim, self.evidence
        return {
            "id": claim.id,
            "section": claim.section,
            "claim": claim.claim,
            "hypothesis": claim.hypothesis,
            "effect": evidence.effect,
            "low": evidence.low,
            "high": evidence.high,
            "p_value": evidence.p_value,
            "verdict": evidence.verdict,
            "optimum": self.optimum,
            "runs": evidence.runs,
        }


def judge_claims(runs: int, seed: int, out: Path, executor: Executor) -> list[Judgement]:
    """Carry out the studies that the claims need and `out` lacks, then judge every claim.

    Raises:
        ValueError: bad numbers, or a store in `out` that holds another study.
    """
    if runs < 2:
        raise ValueError(f"runs: {runs} show no spread; give at least 2")
    studies: dict[tuple[str, str], Runs] = {}
    optima: dict[str, Runs] = {}
    for name in SETTINGS:
        scenario = load_scenario(name, ["start=sampled"])
        studies[name, FILTER] = _study(scenario, runs, seed, FILTER, out / "studies" / name, executor)
        told = informed(scenario)
        measured = told.model_copy(update={"name": "", "description": ""}).model_dump_json()
        if measured not in optima:
            folder = out / "studies" / f"optimum-of-{name}"
            optima[measured] = _study(told, runs, seed, OPTIMUM, folder, executor)
        studies[name, OPTIMUM] = optima[measured]
    return [judge(claim, studies, len(CLAIMS)) for claim in CLAIMS]


def _study(scenario: Scenario, runs: int, seed: int, estimator: str, folder: Path, executor: Executor) -> Runs:
    run_study(scenario, runs, seed, [estimator], folder, executor)
    return load_runs(scenario, runs, seed, [estimator], folder)[estimator]


def judge(claim: Claim, studies: Studies, claims: int) -> Judgement:
    """The evidence for a claim that is one of so many; of several ratios, that which supports it least."""
    ratios = [_log_ratios(claim.figure, other, studies) for other in claim.others]
    evidence = min((weigh(each, claim.asserted, claims) for each in ratios), key=lambda each: each.support)
    setting = claim.figure.setting
    avoidable = 1.0 - math.exp(_log_ratios(ate(setting, OPTIMUM), ate(setting), studies).mean())
    return Judgement(claim, evidence, avoidable)


def weigh(log_ratios: Float, asserted: tuple[float, float], claims: int) -> Evidence:
    """Evidence that the ratio with these logarithms (runs,) lies in the range `asserted`."""
    from scipy.special import stdtr, stdtrit  # here: scipy is slow to start

    runs = len(log_ratios)
    if runs < 2:
        raise ValueError(f"claims: only {runs} run(s) gave all figures; see summary.json's failures, or give more runs")
    mean, error = float(log_ratios.mean()), float(log_ratios.std(ddof=1)) / math.sqrt(runs)
    low, high = (math.log(end) if end > 0.0 else -math.inf for end in asserted)
    margin = min(mean - low, high - mean)  # to the nearest end, negative outside
    support = margin / error if error > 0.0 else margin and math.copysign(math.inf, margin)
    half = float(stdtrit(runs - 1, 1.0 - ALPHA / (2 * claims))) * error
    return Evidence(
        effect=math.exp(mean),
        low=math.exp(mean - half),
        high=math.exp(mean + half),
        p_value=min(1.0, 2.0 * claims * float(stdtr(runs - 1, -abs(support)))),
        support=support,
        runs=runs,
    )


def _log_ratios(above: Figure, below: Figure, studies: Studies) -> Float:
    """Logarithms (runs,) of a ratio in the runs that have both figures, and neither of them 0."""
    ours, theirs = studies[above.setting, above.estimator], studies[below.setting, below.estimator]
    rows, others = paired(ours, theirs)
    ratios = np.divide(above.read(ours)[rows], below.read(theirs)[others])
    return np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def claims_table(judgements: Sequence[Judgement]) -> str:
    """A line for each claim: the practical's conclusion, the ratio with its interval, the verdict."""
    rows = [("section", "the practical", "hypothesis", "ratio", "interval", "p", "verdict", "avoidable")]
    for each in judgements:
        claim, evidence = each.claim, each.evidence
        interval = f"{evidence.low:.3g} to {evidence.high:.3g}"
        p = "< 0.0001" if evidence.p_value < 1e-4 else f"{evidence.p_value:.4f}"
        figures = (f"{evidence.effect:.3g}", interval, p, evidence.verdict, f"{each.optimum:.0%}")
        rows.append((claim.section, claim.claim, claim.hypothesis, *figures))
    counts = Counter(each.evidence.verdict for each in judgements)
    tally = ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("holds", "does not hold", "undecided"))
    return "\n".join([*aligned(rows, words=3), "", f"{len(judgements)} claims: {tally}"])
