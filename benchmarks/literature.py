"""Which claims of publications about filters hold on simulated runs?

    python benchmarks/literature.py [--runs 50] [--seed 100] [--only ID ...] [--jobs 2] [--out results/literature]

`literature.toml` has the claims. Each asserts a range for the ratio of a figure of two estimators in the same run. The
printed ratio is the geometric mean over the runs, and its interval is Student's for the mean logarithm. With 95 %
probability the intervals of all claims of the file contain the true ratios (Bonferroni). A claim holds if its interval
is inside the range, does not hold if it is outside, and is undecided otherwise. `--only` selects claims. Runs are kept
in `--out`: the same command continues after an interruption, and with a larger `--runs` it adds the missing ones.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro

from slamgauge import load_runs, load_scenario, local_processes, run_study
from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import mean_interval
from slamgauge.compare.scoring.runs import Runs, late_means, paired
from slamgauge.compare.studies.summary import failure_lines
from slamgauge.errors import UserError

FILE = Path(__file__).with_suffix(".toml")
LEVEL = 0.95  # probability that the intervals of all claims contain the true ratios
FIGURES: dict[str, Callable[[Runs], Float]] = {
    "NEES": lambda runs: late_means(runs.series["nees_pose"]),  # mean over the steps from the 11th on
    "position NEES": lambda runs: late_means(runs.series["nees_position"]),
    "heading NEES": lambda runs: late_means(runs.series["nees_heading"]),
    "NIS": lambda runs: np.divide(runs.figures["nis_total"], runs.figures["nis_dof_total"]),
    "last heading sigma": lambda runs: runs.series["sigma_heading"][:, -1],
    "ATE": lambda runs: runs.figures["ate_m"],
}
Compared = tuple[str, str]  # setting, estimator


class Claim(NamedTuple):
    """A claim of `literature.toml`: figure, numerator, denominator, and the range of their ratio."""

    id: str
    claim: str
    figure: str
    of: str
    over: str
    range: tuple[float, float]

    def compared(self) -> tuple[Compared, Compared]:
        """Return numerator and denominator."""
        above, _, setting = self.of.partition("@")
        below, _, other = self.over.partition("@")
        return (setting, above), (other or setting, below)

    def hypothesis(self) -> str:
        """Return the claim as a statement about a ratio."""
        low, high = self.range
        asserted = f"> {low:.3g}" if high == math.inf else f"< {high:.3g}" if not low else f"in {low:.3g} to {high:.3g}"
        return f"{self.figure} of {self.of} / of {self.over} {asserted}"


def main(
    runs: int = 50,
    seed: int = 100,
    only: tuple[str, ...] = (),
    jobs: int = 2,
    out: Path = Path("results/literature"),
) -> int:
    content = tomllib.loads(FILE.read_text(encoding="utf-8"))
    claims = [Claim(**each) for each in content["claims"]]
    unknown = [name for name in only if name not in {each.id for each in claims}]
    if unknown or runs < 2:
        what = f"--only {unknown[0]}: no claim of {FILE.name} has this id" if unknown else "--runs: give at least 2"
        raise SystemExit(what)
    chosen = [each for each in claims if not only or each.id in only]
    try:
        found = simulated(chosen, content["settings"], runs, seed, jobs, out)
    except UserError as error:
        raise SystemExit(str(error)) from None
    print(f"{'claim':28}{'ratio':>7}{'interval':>22}  {'verdict':13}  hypothesis")
    for each in chosen:
        print_row(each, log_ratios(each, found), tests=len(claims))
    print(f"with {LEVEL:.0%} probability the intervals of all {len(claims)} claims contain the true ratios")
    for key in dict.fromkeys(each.id.partition("-")[0] for each in chosen):
        print(f"{key}: {content['sources'][key]}")
    return 0


def simulated(
    claims: Sequence[Claim], settings: Mapping[str, Any], runs: int, seed: int, jobs: int, out: Path
) -> dict[Compared, Runs]:
    """Run a study of each setting with the estimators that the claims compare; return the runs of each."""
    needed: dict[str, list[str]] = {}
    for setting, estimator in dict.fromkeys(each for claim in claims for each in claim.compared()):
        needed.setdefault(setting, []).append(estimator)
    found: dict[Compared, Runs] = {}
    with local_processes(jobs) as executor:
        for setting, names in needed.items():
            scenario = load_scenario(settings[setting][0], settings[setting][1:])
            summary = run_study(scenario, runs, seed, names, out / setting, executor)
            for line in failure_lines(summary):
                print(f"{setting}, {line}", file=sys.stderr)
            loaded = load_runs(scenario, runs, seed, names, out / setting)
            found |= {(setting, name): each for name, each in loaded.items()}
    return found


def log_ratios(claim: Claim, found: Mapping[Compared, Runs]) -> Float:
    """Return the logarithms (R,) of a claim's ratio in the runs that have both figures."""
    above, below = (found[each] for each in claim.compared())
    read = FIGURES[claim.figure]
    rows, others = paired(above, below)
    ratios = np.divide(read(above)[rows], read(below)[others])
    return np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])


def verdict(logs: Float, asserted: tuple[float, float], tests: int) -> tuple[str, float, float, float]:
    """Return the verdict on a ratio with the logarithms (R,), and the ratio with both ends of its interval.

    Args:
        logs: logarithms of the ratio in independent runs.
        asserted: range of the ratio that the claim asserts.
        tests: number of claims that are tested.
    """
    interval = mean_interval(logs, 1.0 - (1.0 - LEVEL) / tests)
    if interval is None or interval.low is None or interval.high is None:
        return "undecided", math.nan, 0.0, math.inf
    ratio, low, high = math.exp(interval.mean), math.exp(interval.low), math.exp(interval.high)
    if asserted[0] < low and high < asserted[1]:
        return "holds", ratio, low, high
    return ("does not hold" if high < asserted[0] or low > asserted[1] else "undecided"), ratio, low, high


def print_row(claim: Claim, logs: Float, tests: int) -> None:
    """Print a claim's ratio with its interval, the verdict and the words of the source."""
    result, ratio, low, high = verdict(logs, claim.range, tests)
    interval = f"{low:.3g} to {high:.3g}"
    print(f"{claim.id:28}{ratio:>7.3g}{interval:>22}  {result:13}  {claim.hypothesis()}")
    print(f"    {claim.claim}", flush=True)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
