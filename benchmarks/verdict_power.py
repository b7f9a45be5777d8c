"""How often is each verdict drawn, by the true deviation and the number of runs?

    python benchmarks/verdict_power.py [--trials 1000]

Errors last for the whole run, so the NEES of a run is chi-square with 3 degrees of freedom: the case in which sigmas
are hardest to judge. ATEs of a run are Rayleigh (`comparison.SCATTER`), and the ratio of two estimators scatters by
`SCATTER` from run to run.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np
import tyro

from slamgauge.arrays import Float
from slamgauge.compare.scoring.intervals import ratio_interval
from slamgauge.compare.scoring.verdicts import Evidence

RUNS = (20, 100)  # runs in a study
SIGMAS = (1.0, 1.1, 1.2, 1.5)  # errors over sigmas
RATIOS = (1.0, 1.05, 1.1, 1.2)  # ATE over the optimum's
SCATTER = 0.15  # standard deviation of this ratio between runs
NIS = (1.0, 1.1, 1.2)  # NIS over its degrees of freedom
STEPS = 1000  # steps in a run, each with 2 degrees of freedom of the NIS


def main(trials: int = 1000) -> int:
    rng = np.random.default_rng(0)
    print(f"{trials} trials")
    for title, values, draw in (
        ("errors / sigmas", SIGMAS, _sigma),
        ("ATE / optimum's", RATIOS, _ratio),
        ("NIS / dof", NIS, _nis),
    ):
        print(f"\n{title:28}{'runs':>6}  share of verdicts")
        for value in values:
            for runs in RUNS:
                counts = Counter(draw(value, runs, rng) for _ in range(trials))
                shares = ", ".join(f"{name} {count / trials:.1%}" for name, count in sorted(counts.items()))
                print(f"{value:<28}{runs:>6}  {shares}", flush=True)
    return 0


def _sigma(factor: float, runs: int, rng: np.random.Generator) -> str:
    nees = factor**2 * rng.chisquare(3, runs).mean() / 3
    found = Evidence(runs=runs, nees_per_dof=nees).faults()
    return found[0].replace("claims ", "") if found else "right as far as runs show"


def _ratio(factor: float, runs: int, rng: np.random.Generator) -> str:
    optimum = rng.rayleigh(size=runs)
    ratio = ratio_interval(optimum * factor * np.exp(_scatter(runs, rng)), optimum)
    evidence = Evidence(ratio=ratio, ratio_runs=runs)
    text = evidence.verdict() or ""
    other = "larger error" if evidence.is_worse else "smaller error"
    return next((each for each in ("as accurate", "not significant", "less than") if each in text), other)


def _nis(figure: float, runs: int, rng: np.random.Generator) -> str:
    dof = 2 * STEPS * runs
    found = Evidence(runs=runs, nis_per_dof=figure * rng.chisquare(dof) / dof, nis_dof=dof).faults()
    return found[0] if found else "as expected"


def _scatter(runs: int, rng: np.random.Generator) -> Float:
    """Return logarithms (runs,) of ratios whose mean is 1."""
    return rng.normal(-0.5 * SCATTER**2, SCATTER, runs)


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
