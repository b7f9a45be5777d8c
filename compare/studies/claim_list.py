"""The exercise's conclusions, each as a ratio of figures and the range that the exercise asserts.

`literature_claims` has the claims of publications in the same form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.scoring.aggregation import reported_sigma
from slamgauge.compare.scoring.runs import Runs

FILTER, OPTIMUM = "ekf", CAUSAL  # the exercise's filter, and the causal optimum
NAMES = (
    "q1-short-dense",
    "q1-long-dense",
    "q1-long-sparse",
    "q2-short-dense",
    "q2-long-dense",
    "q2-long-sparse",
    "q2-gate-1",
    "q2-gate-100",
    "q3-scale-0.1",
    "q3-scale-1",
    "q3-scale-2",
    "q3-scale-10",
)
SETTINGS: dict[str, tuple[str, ...]] = {name: (name,) for name in NAMES}
EXERCISE = "ENSTA, course ROB312, TP4"
SECTIONS = {"q1": "2.1", "q2": "2.2", "q3": "3.1"}  # section of the exercise by the first part of a claim's id
SAME = 1.1  # "like", "similar": within this factor
MUCH = 2.0  # "much", "very", "multiplies": at least this factor
LARGE = 1.5  # "large" error: at least this factor of the optimum's
LIMIT = 10.0  # ratios of single runs are limited to this factor
FIRM = 2.0  # limit for sigmas, which hardly differ from run to run
MORE, LESS = (1.0, math.inf), (0.0, 1.0)
START, HALFWAY, RETURN = (0.0, 0.1), (0.45, 0.55), (0.95, 1.05)  # stretches, as shares of the first loop


class Figure(NamedTuple):
    """A figure of every run: setting, estimator, and the function that reads it from the runs."""

    setting: str
    read: Callable[[Runs], Float]
    estimator: str = FILTER


@dataclass(frozen=True)
class Claim:
    """A conclusion of a source: `figure` divided by each of `others` is in the range `asserted`.

    Attributes:
        id: short name; its first part is the question of the exercise or the key of the publication.
        claim: the sentence of the source, shortened.
        hypothesis: the claim as a statement about a ratio.
        figure: numerator of the ratio.
        others: denominators; of several, the least favourable decides.
        asserted: range of the ratio, both ends excluded.
        limit: largest factor by which the ratio of a run counts; near the largest difference of single runs.
        source: publication.
    """

    id: str
    claim: str
    hypothesis: str
    figure: Figure
    others: tuple[Figure, ...]
    asserted: tuple[float, float]
    limit: float = LIMIT
    source: str = EXERCISE

    @property
    def section(self) -> str:
        """Section of the exercise, or key of the publication."""
        key = self.id.partition("-")[0]
        return SECTIONS.get(key, key)

    @property
    def compared(self) -> tuple[Figure, ...]:
        """Numerator and denominators."""
        return self.figure, *self.others


class ClaimSet(NamedTuple):
    """Claims, and the scenario of each setting: a shipped one and overrides, to which a sampled start is added."""

    settings: dict[str, tuple[str, ...]]
    claims: tuple[Claim, ...]

    @property
    def tests(self) -> int:
        """Number of ratios that are tested."""
        return sum(len(claim.others) for claim in self.claims)


def ate(setting: str, estimator: str = FILTER) -> Figure:
    """Return the RMS position error over the path."""
    return stored(setting, "ate_m", estimator)


def stored(setting: str, key: str, estimator: str = FILTER) -> Figure:
    """Return a figure that the study has stored."""

    def read(runs: Runs) -> Float:
        return runs.figures[key]

    return Figure(setting, read, estimator)


def landmarks_found(setting: str) -> Figure:
    """Return the number of true landmarks that are mapped; 0.5 for none, since ratios are compared by logarithms."""

    def read(runs: Runs) -> Float:
        return np.maximum(runs.figures["landmarks_true"] - runs.figures["landmarks_missed"], 0.5)

    return Figure(setting, read)


def during(setting: str, what: str, first: float, last: float) -> Figure:
    """Return the RMS position `error` or `sigma` in a stretch of the first of two loops, in shares of the loop."""

    def read(runs: Runs) -> Float:
        squares = runs.series[f"{what}_x"] ** 2 + runs.series[f"{what}_y"] ** 2
        loop = (squares.shape[1] - 1) / 2
        return np.sqrt(squares[:, round(first * loop) : round(last * loop) + 1].mean(axis=1))

    return Figure(setting, read)


def sigma(setting: str) -> Figure:
    """Return the RMS position sigma that the filter reports."""
    return Figure(setting, reported_sigma)


CLAIMS = (
    Claim(
        "q1-near-landmarks-error",
        "landmarks near the start are better localised than far ones",
        "error of the far half of the map / of the near half > 1",
        stored("q1-long-dense", "landmark_error_far_m"),
        (stored("q1-long-dense", "landmark_error_near_m"),),
        MORE,
    ),
    Claim(
        "q1-near-landmarks-sigma",
        "their uncertainty is smaller",
        "sigma of the far half of the map / of the near half > 1",
        stored("q1-long-dense", "landmark_sigma_far_m"),
        (stored("q1-long-dense", "landmark_sigma_near_m"),),
        MORE,
        limit=FIRM,
    ),
    Claim(
        "q1-error-grows",
        "the error accumulates along the loop",
        "position error halfway round / near the start > 1",
        during("q1-long-dense", "error", *HALFWAY),
        (during("q1-long-dense", "error", *START),),
        MORE,
    ),
    Claim(
        "q1-sigma-grows",
        "so does the uncertainty",
        "position sigma halfway round / near the start > 1",
        during("q1-long-dense", "sigma", *HALFWAY),
        (during("q1-long-dense", "sigma", *START),),
        MORE,
        limit=FIRM,
    ),
    Claim(
        "q1-error-falls",
        "the error is corrected at the start point",
        "position error at the closure / halfway round < 1",
        during("q1-long-dense", "error", *RETURN),
        (during("q1-long-dense", "error", *HALFWAY),),
        LESS,
    ),
    Claim(
        "q1-sigma-falls",
        "so is the uncertainty",
        "position sigma at the closure / halfway round < 1",
        during("q1-long-dense", "sigma", *RETURN),
        (during("q1-long-dense", "sigma", *HALFWAY),),
        LESS,
        limit=FIRM,
    ),
    Claim(
        "q1-sparse-error",
        "on the sparse map the error is big",
        f"ATE on the sparse map / on the dense one > {MUCH:g}",
        ate("q1-long-sparse"),
        (ate("q1-long-dense"),),
        (MUCH, math.inf),
    ),
    Claim(
        "q2-gate-1-landmarks",
        "a gate that is too small maps more landmarks than there are",
        "landmarks mapped / there, at gate 1 > 1",
        stored("q2-gate-1", "landmarks_mapped"),
        (stored("q2-gate-1", "landmarks_true"),),
        MORE,
    ),
    Claim(
        "q2-gate-100-landmarks",
        "a gate that is too large ignores some landmarks",
        "landmarks found / there, at gate 100 < 1",
        landmarks_found("q2-gate-100"),
        (stored("q2-gate-100", "landmarks_true"),),
        LESS,
        limit=1.1,  # one or two of 37 landmarks are missing
    ),
    Claim(
        "q2-gate-100-error",
        "and multiplies the error",
        f"ATE at gate 100 / at gate 9 > {MUCH:g}",
        ate("q2-gate-100"),
        (ate("q2-long-dense"),),
        (MUCH, math.inf),
    ),
    *(
        Claim(
            f"q2-like-known-{name}",
            f"with gate 9 the {name.replace('-', ', ')} map looks as with known association",
            f"ATE with gate 9 / with known association within 1/{SAME:g} and {SAME:g}",
            ate(f"q2-{name}"),
            (ate(f"q1-{name}"),),
            (1.0 / SAME, SAME),
        )
        for name in ("short-dense", "long-dense")
    ),
    Claim(
        "q2-unlike-known-sparse",
        "with too few landmarks it does not",
        f"ATE with gate 9 / with known association > {SAME:g}",
        ate("q2-long-sparse"),
        (ate("q1-long-sparse"),),
        (SAME, math.inf),
    ),
    Claim(
        "q3-scale-0.1-landmarks",
        "with Q and Py too small, landmarks are misidentified",
        "landmarks mapped / there, at scale 0.1 > 1",
        stored("q3-scale-0.1", "landmarks_mapped"),
        (stored("q3-scale-0.1", "landmarks_true"),),
        MORE,
    ),
    Claim(
        "q3-scale-0.1-error",
        "and the error is really big",
        f"ATE at scale 0.1 / the optimum's > {LARGE:g}",
        ate("q3-scale-0.1"),
        (ate("q3-scale-0.1", OPTIMUM),),
        (LARGE, math.inf),
    ),
    Claim(
        "q3-scale-1-error",
        "with the true noise the error is smaller",
        "ATE at scale 1 / at scale 0.1 < 1",
        ate("q3-scale-1"),
        (ate("q3-scale-0.1"),),
        LESS,
    ),
    Claim(
        "q3-scale-10-error",
        "with ten times the noise it is smaller still",
        "ATE at scale 10 / at scale 1 < 1",
        ate("q3-scale-10"),
        (ate("q3-scale-1"),),
        LESS,
    ),
    Claim(
        "q3-scale-10-sigma",
        "but the uncertainty is very big",
        f"reported sigma at scale 10 / at scale 1 > {MUCH:g}",
        sigma("q3-scale-10"),
        (sigma("q3-scale-1"),),
        (MUCH, math.inf),
        limit=FIRM,
    ),
    Claim(
        "q3-scale-2-best",
        "the best choice is twice the noise",
        "ATE at scale 2 / at each of 0.1, 1 and 10 < 1",
        ate("q3-scale-2"),
        (ate("q3-scale-0.1"), ate("q3-scale-1"), ate("q3-scale-10")),
        LESS,
    ),
)
