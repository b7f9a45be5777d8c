"""Conclusions of the exercise and of the literature as tests over Monte Carlo runs.

A claim asserts that a ratio of two figures of the same run is in a range. It holds if the interval of the ratio
(`claim_evidence`) is inside the range, does not hold if it is outside, and is undecided otherwise: then its settings
run on to the next look, with half as many runs more, up to the last look.

Settings that simulate the same have the same measurements, run by run; settings with the same path have the same start
and odometry.
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
from slamgauge.compare.estimators.memory_check import require_room_for_runs
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario, scenario_text
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.aggregation import share_in_doubt
from slamgauge.compare.scoring.nan_stats import mean
from slamgauge.compare.scoring.optimum_notes import MARK, at_places
from slamgauge.compare.scoring.runs import Runs, paired
from slamgauge.compare.scoring.sequential import growing
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell, marked
from slamgauge.compare.storage.files import write_json
from slamgauge.compare.storage.manifest import require_folder, require_free
from slamgauge.compare.storage.provenance import origin
from slamgauge.compare.storage.result_files import CLAIMS as CLAIMS_FILE
from slamgauge.compare.storage.result_files import CLAIMS_FILES, STORE_FILES
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.claim_evidence import ALPHA, Evidence, weigh
from slamgauge.compare.studies.claim_list import CLAIMS, EXERCISE, OPTIMUM, SETTINGS, Claim, ClaimSet, Figure, ate
from slamgauge.compare.studies.literature_claims import LITERATURE
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.summary import failure_lines
from slamgauge.errors import UserError

Load = Callable[[str, str, int], Runs]  # (setting, estimator, number of runs)

SETS = {"exercise": ClaimSet(SETTINGS, CLAIMS), "literature": LITERATURE}
TOGETHER = 2  # studies in memory at a time: those of one ratio
CERTAINTY = f"with {1 - ALPHA:.0%} probability no verdict is wrong and all intervals hold, after any number of runs"


@dataclass(frozen=True)
class Judgement:
    """The evidence for a claim, and the optimum of its setting.

    `optimum` is the share of the filter's error that the causal optimum avoids, with true noise and associations (1 -
    geometric mean of its ATE over the filter's, in the runs of the first look); None without runs.
    `optimum_check_share` is the share of these runs in which the optimum is in doubt; None if none was checked.
    `scenario_text` is the setting as a TOML file, `seed` the root seed, `digest` that of both.
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
        """Whether the verdict depends on an optimum in doubt."""
        return bool(self.optimum_check_share) and any(each.estimator == OPTIMUM for each in self.claim.compared)

    def to_json(self) -> dict[str, Any]:
        """Return the claim's entry in claims.json."""
        claim, evidence = self.claim, self.evidence
        figures = evidence._asdict()
        del figures["support"]
        return {
            **{key: getattr(claim, key) for key in ("id", "section", "source", "claim", "hypothesis")},
            **figures,
            "verdict": evidence.verdict,
            "optimum": self.optimum,
            "optimum_check_share": self.optimum_check_share,
            "setting": claim.figure.setting,
            "seed": self.seed,
            "digest": self.digest,
            **origin(self.scenario_text),
        }


class Claims(NamedTuple):
    """The judgement of every claim, and a line for each run in which an estimator failed."""

    judgements: list[Judgement]
    failures: list[str]
    origin: str = "exercise"


class Look(NamedTuple):
    """Number of runs that are looked at, largest number of runs, and number of ratios that are tested."""

    runs: int
    most: int
    tests: int


class _Studies:
    """A study folder for each setting and estimator; settings with the same measurements share the optimum."""

    def __init__(
        self, settings: dict[str, Scenario], claims: tuple[Claim, ...], seed: int, out: Path, executor: Executor
    ) -> None:
        self._seed, self._executor = seed, executor
        self._studies: dict[tuple[str, str], tuple[Scenario, Path]] = {}
        self._done: dict[Path, int] = {}
        self._failures: dict[Path, list[str]] = {}
        inside = require_folder(out, "studies")
        optima: dict[str, tuple[Scenario, Path]] = {}
        figures = [each for claim in claims for each in (*claim.compared, ate(claim.figure.setting, OPTIMUM))]
        for name, _, estimator in figures:
            if estimator == OPTIMUM:
                exact = informed(settings[name])
                optimum = exact, require_folder(inside, f"{OPTIMUM}-{name}")
                self._studies[name, OPTIMUM] = optima.setdefault(exact.model_dump_json(), optimum)
            else:
                self._studies[name, estimator] = settings[name], require_folder(inside, f"{estimator}-{name}")
        for _, folder in self._studies.values():
            require_free(folder, STORE_FILES)

    @property
    def failures(self) -> list[str]:
        """A line for each run in which an estimator failed."""
        return [line for lines in self._failures.values() for line in lines]

    def load(self, setting: str, estimator: str, runs: int) -> Runs:
        """Return the first `runs` runs; missing ones are run."""
        scenario, folder = self._studies[setting, estimator]
        if self._done.get(folder, 0) < runs:
            summary = run_study(scenario, runs, self._seed, [estimator], folder, self._executor)
            self._failures[folder] = [f"{folder.name}, {line}" for line in failure_lines(summary)]
            self._done[folder] = runs
        return load_runs(scenario, runs, self._seed, [estimator], folder)[estimator]


def scenarios_of_settings(settings: dict[str, tuple[str, ...]]) -> dict[str, Scenario]:
    """Return the scenario of each setting."""
    return {key: load_scenario(name, changes) for key, (name, *changes) in settings.items()}


def judge_claims(
    runs: int, seed: int, out: str | Path, executor: Executor, most: int | None = None, of: str = "exercise"
) -> Claims:
    """Run what the claims need and `out` lacks, and judge every claim.

    Args:
        runs: runs of each setting at the first look.
        seed: root seed.
        out: folder of the studies.
        executor: see `run_study`.
        most: largest number of runs for claims that are undecided; None: `runs`.
        of: `exercise` or `literature`.

    Raises:
        UserError: bad numbers, a store of another study in `out`, or a foreign file in the place of a result.
    """
    if runs < 2:
        raise UserError(f"runs: {runs} show no spread; give at least 2")
    most, out = runs if most is None else most, Path(out)
    if most < runs:
        raise UserError(f"max-runs: {most} is less than the {runs} runs that it begins with; give at least {runs}")
    if of not in SETS:
        raise UserError(f"of: {of!r} has no claims; give one of {', '.join(SETS)}")
    require_free(out, CLAIMS_FILES)
    claims, tests = SETS[of].claims, SETS[of].tests
    settings = scenarios_of_settings(SETS[of].settings)
    studies = _Studies(settings, claims, seed, out, executor)
    for scenario in settings.values():
        require_room_for_runs(most, scenario, TOGETHER)
    first = Look(runs, most, tests)
    judged = [judge(claim, studies.load, first, settings[claim.figure.setting], seed) for claim in claims]
    for count in growing(runs, most)[1:]:
        look = Look(count, most, tests)
        for place, each in enumerate(judged):
            if each.evidence.verdict == "undecided":
                judged[place] = replace(each, evidence=evidence_for(each.claim, studies.load, look))
    return Claims(judged, studies.failures, of)


def write_claims(out: Path, claims: Claims) -> None:
    """Write claims.json into `out`."""
    with staged_folder(out, CLAIMS_FILES, last=CLAIMS_FILE) as stage:
        write_json(stage / CLAIMS_FILE, [each.to_json() for each in claims.judgements])


def judge(claim: Claim, load: Load, look: Look, scenario: Scenario, seed: int) -> Judgement:
    """Judge a claim by the first runs; `scenario` is its setting."""
    setting, estimator = claim.figure.setting, claim.figure.estimator
    optimum = mean(log_ratios(ate(setting, OPTIMUM), ate(setting, estimator), load, look.runs))
    avoidable = None if optimum is None else 1.0 - math.exp(optimum)
    share = share_in_doubt(load(setting, OPTIMUM, look.runs), {})
    where = scenario_text(scenario), seed, digest(scenario, seed)
    return Judgement(claim, evidence_for(claim, load, look), avoidable, share, *where)


def evidence_for(claim: Claim, load: Load, look: Look) -> Evidence:
    """Return the evidence of the runs of a look; of several ratios, that of the least favourable."""
    ratios = [log_ratios(claim.figure, other, load, look.runs) for other in claim.others]
    return min((weigh(each, claim, look.tests, look.most) for each in ratios), key=lambda each: each.support)


def log_ratios(above: Figure, below: Figure, load: Load, runs: int) -> Float:
    """Return the logarithms (runs,) of a ratio in the runs that have both figures."""
    ours, theirs = (load(each.setting, each.estimator, runs) for each in (above, below))
    rows, others = paired(ours, theirs)
    if not len(rows):
        return np.zeros(0)
    ratios = np.divide(above.read(ours)[rows], below.read(theirs)[others])
    return np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def claims_table(claims: Claims) -> Page:
    """Return a table with a row for each claim: conclusion, verdict and ratio with interval; below it failures."""
    heads = ("ratio", "interval", "p", "avoidable", "runs", "decidable")
    rows: list[tuple[str, ...]] = [("section", f"the {claims.origin}", "verdict", *heads, "hypothesis")]
    shares = {each.claim.figure.setting: each.optimum_check_share for each in claims.judgements}
    room_for_marks = any(shares.values())
    for each in claims.judgements:
        claim, evidence = each.claim, each.evidence
        effect, low, high = (cell(value, "{:.3g}") for value in (evidence.effect, evidence.low, evidence.high))
        p = "< 0.0001" if evidence.p_value < 1e-4 else f"{evidence.p_value:.4f}"
        verdict, avoidable = evidence.verdict, cell(each.optimum, "{:.0%}")
        if room_for_marks:
            effect, verdict = (marked(text, MARK, is_marked=each.is_in_doubt) for text in (effect, verdict))
            avoidable = marked(avoidable, MARK, is_marked=bool(each.optimum_check_share))
        decidable = cell(evidence.decidable, "x {:.3f}")
        figures = (effect, f"{low} to {high}", p, avoidable, str(evidence.runs), decidable)
        rows.append((claim.section, claim.claim, verdict, *figures, claim.hypothesis))
    counts = Counter(each.evidence.verdict for each in claims.judgements)
    tally = ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("holds", "does not hold", "undecided"))
    doubts = at_places(OPTIMUM, shares)
    grid = Grid(rows, words=(0, 1, 2, 9), sentences=1)
    cited = {each.claim.section: each.claim.source for each in claims.judgements if each.claim.source != EXERCISE}
    sources = [f"{key}: {source}" for key, source in cited.items()]
    return Page((grid, "", f"{len(rows) - 1} claims: {tally}", CERTAINTY, *sources, *doubts, *claims.failures))
