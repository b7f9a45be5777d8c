"""The practical's conclusions, put to the test over Monte Carlo runs.

A claim asserts that a ratio of two figures of the same run lies in a range. Over runs the logarithm of the
ratio has a mean, which Student's distribution bounds; the effect is the geometric mean of the ratios. The claim
holds when the effect lies in the range and the range's nearest end is rejected at 5 %, does not hold when the
effect lies outside and that end is rejected, and is undecided otherwise. p-values and intervals are corrected
for the number of ratios tested (Bonferroni). Settings that simulate the same see the same measurements, run by run.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.asked import Asked, ask
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.scenario_text import scenario_text
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.defined import mean, number
from slamgauge.compare.scoring.optimum_notes import MARK, at_places
from slamgauge.compare.scoring.over_runs import share_in_doubt
from slamgauge.compare.scoring.runs import Runs, paired
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, marked
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.manifest import require_folder, require_free
from slamgauge.compare.storage.origin import origin
from slamgauge.compare.storage.result_files import CLAIMS as CLAIMS_FILE
from slamgauge.compare.storage.result_files import CLAIMS_FILES, STORE_FILES
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.claim_list import CLAIMS, FILTER, OPTIMUM, SETTINGS, Claim, Figure, ate
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.summary import failure_lines
from slamgauge.errors import UserError

ALPHA = 0.05
Studies = Mapping[tuple[str, str], Runs]  # by setting and estimator


class Evidence(NamedTuple):
    """What the runs say of one ratio; figures are None with fewer than two runs, or where they overflow.

    Attributes:
        effect: its geometric mean over runs.
        low: lower end of its interval, corrected for the number of ratios that are tested.
        high: upper end.
        p_value: of the asserted range's nearest end, two-sided, corrected.
        support: Student's statistic of that end, positive where the effect lies inside the range.
        runs: how many had both figures.
    """

    effect: float | None
    low: float | None
    high: float | None
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
    associations (1 - geometric mean over runs of its ATE over the filter's); None if it has no run.
    `optimum_check_share` is the share of its runs there in which it is in doubt; None if none was checked.
    """

    claim: Claim
    evidence: Evidence
    optimum: float | None
    optimum_check_share: float | None

    @property
    def is_in_doubt(self) -> bool:
        """Whether the verdict itself rests on an optimum in doubt."""
        compared = (self.claim.figure, *self.claim.others)
        return bool(self.optimum_check_share) and any(each.estimator == OPTIMUM for each in compared)

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
            "optimum_check_share": self.optimum_check_share,
            "runs": evidence.runs,
            **origin(scenario_text(_sampled(claim.figure.setting))),
        }


class Claims(NamedTuple):
    """The judgement of every claim, and a line for each run that an estimator did not survive."""

    judgements: list[Judgement]
    failures: list[str]


def judge_claims(runs: int, seed: int, out: Path, executor: Executor) -> Claims:
    """Carry out the studies that the claims need and `out` lacks, then judge every claim.

    Raises:
        UserError: bad numbers, a store in `out` that holds another study, or a file that is not ours would be replaced.
    """
    if runs < 2:
        raise UserError(f"runs: {runs} show no spread; give at least 2")
    require_free(out, CLAIMS_FILES)
    inside = require_folder(out, "studies")
    for name in SETTINGS:
        for folder in (name, f"optimum-of-{name}"):
            require_free(require_folder(inside, folder), STORE_FILES)
    studies: dict[tuple[str, str], Runs] = {}
    failures: list[str] = []

    def study(scenario: Scenario, estimator: str, folder: Path) -> Runs:
        summary = run_study(scenario, runs, seed, [estimator], folder, executor)
        failures.extend(f"{folder.name}, {line}" for line in failure_lines(summary))
        return load_runs(scenario, runs, seed, [estimator], folder)[estimator]

    optima: dict[str, Runs] = {}
    for name in SETTINGS:
        scenario = _sampled(name)
        studies[name, FILTER] = study(scenario, FILTER, out / "studies" / name)
        told = informed(scenario)
        same = told.model_dump_json()
        if same not in optima:
            optima[same] = study(told, OPTIMUM, out / "studies" / f"optimum-of-{name}")
        studies[name, OPTIMUM] = optima[same]
    tests = sum(len(claim.others) for claim in CLAIMS)
    return Claims([judge(claim, studies, tests) for claim in CLAIMS], failures)


def _sampled(setting: str) -> Scenario:
    """The scenario of a setting."""
    return load_scenario(setting, ["start=sampled"])


def studies_of_claims() -> list[tuple[Scenario, list[Asked]]]:
    """What every run of the claims is made of."""
    return [(_sampled(name), ask([FILTER, OPTIMUM])) for name in SETTINGS]


def write_claims(out: Path, claims: Claims) -> None:
    """Write claims.json into `out`."""
    with staged_folder(out, CLAIMS_FILES, last=CLAIMS_FILE) as stage:
        write_json(stage / CLAIMS_FILE, [each.to_json() for each in claims.judgements])


def judge(claim: Claim, studies: Studies, tests: int) -> Judgement:
    """The evidence for a claim, where so many ratios are tested; of several, that which supports it least."""
    ratios = [_log_ratios(claim.figure, other, studies) for other in claim.others]
    evidence = min((weigh(each, claim.asserted, tests) for each in ratios), key=lambda each: each.support)
    setting = claim.figure.setting
    optimum = mean(_log_ratios(ate(setting, OPTIMUM), ate(setting), studies))
    share = share_in_doubt(studies[setting, OPTIMUM], {})
    return Judgement(claim, evidence, None if optimum is None else 1.0 - math.exp(optimum), share)


def weigh(log_ratios: Float, asserted: tuple[float, float], tests: int) -> Evidence:
    """Evidence that the ratio with these logarithms (runs,) lies in the range `asserted`, as one of so many tests."""
    from scipy.special import stdtr, stdtrit  # here: scipy is slow to start

    runs = len(log_ratios)
    if runs < 2:
        return Evidence(None, None, None, p_value=1.0, support=0.0, runs=runs)
    effect, error = float(log_ratios.mean()), float(log_ratios.std(ddof=1)) / math.sqrt(runs)
    low, high = (math.log(end) if end > 0.0 else -math.inf for end in asserted)
    margin = min(effect - low, high - effect)  # to the nearest end, negative outside
    support = margin / error if error > 0.0 else margin and math.copysign(math.inf, margin)
    half = float(stdtrit(runs - 1, 1.0 - ALPHA / (2 * tests))) * error
    with np.errstate(over="ignore"):
        ends = np.exp([effect, effect - half, effect + half])
    return Evidence(
        *map(number, ends),
        p_value=min(1.0, 2.0 * tests * float(stdtr(runs - 1, -abs(support)))),
        support=support,
        runs=runs,
    )


def _log_ratios(above: Figure, below: Figure, studies: Studies) -> Float:
    """Logarithms (runs,) of a ratio in the runs that have both figures."""
    ours, theirs = studies[above.setting, above.estimator], studies[below.setting, below.estimator]
    rows, others = paired(ours, theirs)
    if not len(rows):
        return np.zeros(0)
    ratios = np.divide(above.read(ours)[rows], below.read(theirs)[others])
    return np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def claims_table(claims: Claims) -> Page:
    """A line for each claim: the practical's conclusion, the ratio with its interval, the verdict; then failures."""
    rows = [("section", "the practical", "verdict", "ratio", "interval", "p", "avoidable", "runs", "hypothesis")]
    shares = {each.claim.figure.setting: each.optimum_check_share for each in claims.judgements}
    room_for_marks = any(shares.values())
    for each in claims.judgements:
        claim, evidence = each.claim, each.evidence
        interval = f"{_three(evidence.low)} to {_three(evidence.high)}"
        p = "< 0.0001" if evidence.p_value < 1e-4 else f"{evidence.p_value:.4f}"
        effect, verdict, avoidable = _three(evidence.effect), evidence.verdict, cell(each.optimum, "{:.0%}")
        if room_for_marks:
            effect, verdict = (marked(text, MARK, is_marked=each.is_in_doubt) for text in (effect, verdict))
            avoidable = marked(avoidable, MARK, is_marked=bool(each.optimum_check_share))
        figures = (effect, interval, p, avoidable, str(evidence.runs))
        rows.append((claim.section, claim.claim, verdict, *figures, claim.hypothesis))
    counts = Counter(each.evidence.verdict for each in claims.judgements)
    tally = ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("holds", "does not hold", "undecided"))
    doubts = at_places(OPTIMUM, shares)
    grid = Grid(rows, words=(0, 1, 2, 8), sentences=1)
    return Page((grid, "", f"{len(rows) - 1} claims: {tally}", *doubts, *claims.failures))


def _three(value: float | None) -> str:
    return cell(value, "{:.3g}")
