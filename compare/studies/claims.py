"""The practical's conclusions, put to the test over Monte Carlo runs, as many as it takes to decide each.

A claim asserts that a ratio of two figures of the same run lies in a range. It holds when the ratio's interval lies
inside (`claim_evidence`), does not hold when it lies outside, and is undecided otherwise: then the settings that it is
about go on to the next look, at half as many runs more, and so on to the last.

Settings that simulate the same see the same measurements, run by run; of others with the same path start and odometry
are the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.scenario_text import scenario_text
from slamgauge.compare.scoring.aggregation import share_in_doubt
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_notes import MARK, at_places
from slamgauge.compare.scoring.runs import Runs, paired
from slamgauge.compare.scoring.sequential import growing
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, marked
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.manifest import require_free
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.storage.result_files import CLAIMS as CLAIMS_FILE
from slamgauge.compare.storage.result_files import CLAIMS_FILES
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.claim_evidence import ALPHA, Evidence, weigh
from slamgauge.compare.studies.claim_list import CLAIMS, OPTIMUM, SETTINGS, TESTS, Claim, Figure, ate
from slamgauge.compare.studies.claim_studies import ClaimStudies, sampled_settings
from slamgauge.compare.studies.store import digest
from slamgauge.errors import UserError

Load = Callable[[str, str, int], Runs]  # of a setting and an estimator the first so many runs


CERTAINTY = f"with {1 - ALPHA:.0%} probability no verdict is wrong and all intervals hold, after any number of runs"


@dataclass(frozen=True)
class Judgement:
    """The evidence for a claim, and what the optimum says of its setting.

    `optimum` is the share of the filter's error there that the causal optimum avoids, which is told true noise and
    associations (1 - geometric mean over the first look's runs of its ATE over the filter's); None if it has no run.
    `optimum_check_share` is the share of these runs in which it is in doubt; None if none was checked. `scenario_text`
    is the setting as a TOML file, `seed` the root of the runs' own, `digest` that of both.
    """

    claim: Claim
    evidence: Evidence
    optimum: float | None
    optimum_check_share: float | None
    scenario_text: str
    seed: int
    digest: str

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
            "decidable": evidence.decidable,
            "setting": claim.figure.setting,
            "seed": self.seed,
            "digest": self.digest,
            **origin(self.scenario_text),
        }


class Claims(NamedTuple):
    """The judgement of every claim, and a line for each run that an estimator did not survive."""

    judgements: list[Judgement]
    failures: list[str]


def judge_claims(runs: int, seed: int, out: str | Path, executor: Executor, most: int | None = None) -> Claims:
    """Carry out the runs that the claims need and `out` lacks, and judge every claim.

    Args:
        runs: of each setting, after which all claims are judged.
        seed: root seed, from which the runs' own seeds are spawned.
        out: folder of the studies; what it has is not carried out again.
        executor: carries the runs.
        most: how many runs claims that are undecided go on to; None: no more than `runs`.

    Raises:
        UserError: bad numbers, a store in `out` that holds another study, or a file that is not ours would be replaced.
    """
    if runs < 2:
        raise UserError(f"runs: {runs} show no spread; give at least 2")
    if most is not None and most < 1:
        raise UserError(f"max-runs: {most} are none; give at least 1")
    most, out = max(runs, most or 0), Path(out)
    require_free(out, CLAIMS_FILES)
    studies = ClaimStudies(sampled_settings(SETTINGS), seed, out, executor)
    studies.require_room(most)
    settings = studies.scenarios
    judged = [judge(claim, studies.load, runs, most, settings[claim.figure.setting], seed) for claim in CLAIMS]
    for count in growing(runs, most)[1:]:
        for place, each in enumerate(judged):
            if each.evidence.verdict == "undecided":
                judged[place] = replace(each, evidence=evidence_for(each.claim, studies.load, count, most))
    return Claims(judged, studies.failures)


def write_claims(out: Path, claims: Claims) -> None:
    """Write claims.json into `out`."""
    with staged_folder(out, CLAIMS_FILES, last=CLAIMS_FILE) as stage:
        write_json(stage / CLAIMS_FILE, [each.to_json() for each in claims.judgements])


def judge(claim: Claim, load: Load, runs: int, most: int, scenario: Scenario, seed: int) -> Judgement:
    """What the first runs say of a claim, where there may be `most`; `scenario` is its setting."""
    setting = claim.figure.setting
    optimum = mean(log_ratios(ate(setting, OPTIMUM), ate(setting), load, runs))
    avoidable = None if optimum is None else 1.0 - math.exp(optimum)
    share = share_in_doubt(load(setting, OPTIMUM, runs), {})
    where = scenario_text(scenario), seed, digest(scenario, seed)
    return Judgement(claim, evidence_for(claim, load, runs, most), avoidable, share, *where)


def evidence_for(claim: Claim, load: Load, runs: int, most: int) -> Evidence:
    """What the first runs say of the ratio of a claim; of several ratios, of that which supports it least."""
    ratios = [log_ratios(claim.figure, other, load, runs) for other in claim.others]
    return min((weigh(each, claim, TESTS, most) for each in ratios), key=lambda each: each.support)


def log_ratios(above: Figure, below: Figure, load: Load, runs: int) -> Float:
    """Logarithms (runs,) of a ratio in the runs that have both figures."""
    ours, theirs = (load(each.setting, each.estimator, runs) for each in (above, below))
    rows, others = paired(ours, theirs)
    if not len(rows):
        return np.zeros(0)
    ratios = np.divide(above.read(ours)[rows], below.read(theirs)[others])
    return np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def claims_table(claims: Claims) -> Page:
    """A line for each claim: the practical's conclusion, the ratio with its interval, the verdict; then failures."""
    heads = ("ratio", "interval", "p", "avoidable", "runs", "decidable")
    rows: list[tuple[str, ...]] = [("section", "the practical", "verdict", *heads, "hypothesis")]
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
        figures = (effect, interval, p, avoidable, str(evidence.runs), cell(evidence.decidable, "x {:.3f}"))
        rows.append((claim.section, claim.claim, verdict, *figures, claim.hypothesis))
    counts = Counter(each.evidence.verdict for each in claims.judgements)
    tally = ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("holds", "does not hold", "undecided"))
    doubts = at_places(OPTIMUM, shares)
    grid = Grid(rows, words=(0, 1, 2, 9), sentences=1)
    return Page((grid, "", f"{len(rows) - 1} claims: {tally}", CERTAINTY, *doubts, *claims.failures))


def _three(value: float | None) -> str:
    return cell(value, "{:.3g}")
