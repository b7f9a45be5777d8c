"""What `slamgauge claims` can decide, before it is asked: power and false verdicts on runs like those of other roots.

    python benchmarks/claims_power.py [--claims all] [--roots 10] [--runs 20] [--most 3000] [--studies 400] [--jobs 2]
        [--out results/claims-power]

Runs of the root seeds 0 to 9 say how ratios scatter; `--claims` are ids with commas. Studies are drawn from them with
replacement, and looked at as claims are. A line for each ratio: its geometric mean over the end of its range that is
nearest; the factor that is decided with 90 %; how many studies decide at that mean, and after how many runs in the
median; how many decide wrongly once all ratios are moved to that very end, where 5 % / 21 may.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.scoring.confidence_sequence import growth_of, location, smallest_effect
from slamgauge.compare.scoring.sequential import growing
from slamgauge.compare.studies.claim_evidence import log_threshold
from slamgauge.compare.studies.claim_list import CLAIMS, SETTINGS, TESTS, Claim, Figure
from slamgauge.compare.studies.claim_studies import ClaimStudies, sampled_settings
from slamgauge.compare.studies.claims import log_ratios
from slamgauge.compare.studies.executors import local_processes

FIRST = 20  # runs until claims are looked at
LOG_THRESHOLD = log_threshold(TESTS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--claims", default="all")
    parser.add_argument("--roots", type=int, default=10)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--most", type=int, default=3000)
    parser.add_argument("--studies", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/claims-power"))
    options = parser.parse_args()
    asked = options.claims.split(",")
    settings, counts = sampled_settings(SETTINGS), growing(FIRST, options.most)
    heads = ("runs", "x end", "decidable", "decided %", "after", "wrong %")
    print(f"{'claim':<28}{'over':<16}" + "".join(f"{head:>11}" for head in heads))
    with local_processes(options.jobs) as executor:
        roots = [ClaimStudies(settings, root, options.out / f"root{root}", executor) for root in range(options.roots)]
        for claim in CLAIMS:
            if asked != ["all"] and claim.id not in asked:
                continue
            for other in claim.others:
                known = ratios_of(claim, other, roots, options.runs)
                figures = judge(known, claim, counts, options.studies)
                print(f"{claim.id:<28}{other.setting:<16}" + "".join(f"{each:>11}" for each in figures), flush=True)


def ratios_of(claim: Claim, other: Figure, roots: Sequence[ClaimStudies], runs: int) -> Float:
    """Logarithms of a ratio in the runs of all roots."""
    return np.concatenate([log_ratios(claim.figure, other, root.load, runs) for root in roots])


def judge(known: Float, claim: Claim, counts: Sequence[int], studies: int) -> tuple[str, ...]:
    """The figures of a line."""
    limit, most = math.log(claim.limit), counts[-1]
    mean = location(known, limit)
    end = min((math.log(end) for end in claim.asserted if 0.0 < end < math.inf), key=lambda end: abs(mean - end))
    away = (known - end) * (1.0 if mean >= end else -1.0)
    centred = away - location(away, limit)
    rng = np.random.default_rng(0)
    found = reached(away, limit, counts, studies, rng)
    wrong = reached(centred, limit, counts, studies, rng) | reached(-centred, limit, counts, studies, rng)
    after = np.array([*counts, math.inf])[np.where(found.any(axis=1), found.argmax(axis=1), len(counts))]
    return (
        str(len(known)),
        f"{math.exp(mean - end):.3f}",
        f"{math.exp(smallest_effect(known, limit, LOG_THRESHOLD, most)):.3f}",
        f"{100 * found.any(axis=1).mean():.1f}",
        f"{np.median(after):.0f}",
        f"{100 * wrong.any(axis=1).mean():.2f}",
    )


def reached(known: Float, limit: float, counts: Sequence[int], studies: int, rng: np.random.Generator) -> Marks:
    """Whether bets on more than zero have reached the threshold, in every study at every look (studies, K)."""
    drawn = rng.integers(0, len(known), (studies, counts[-1]))
    made = np.array([np.cumsum(each[drawn], axis=1)[:, np.array(counts) - 1] for each in growth_of(known, limit)])
    return np.exp(made).mean(axis=0) >= math.exp(LOG_THRESHOLD)


if __name__ == "__main__":
    main()
