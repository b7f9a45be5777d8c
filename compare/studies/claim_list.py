"""The practical's conclusions, as ratios that its text asserts to lie in a range."""

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

FILTER, OPTIMUM = "ekf", CAUSAL  # the practical's filter, and the causal optimum
SETTINGS = (
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
SAME = 1.1  # what "like" and "similar" may mean: within this factor
MUCH = 2.0  # what "much", "very" and "multiplies" mean at least
LARGE = 1.5  # what a "large" error is at least, next to the optimum's
LIMIT = 10.0  # no run counts as farther off than by this factor
FIRM = 2.0  # the same of sigmas, which hardly differ from run to run
MORE, LESS = (1.0, math.inf), (0.0, 1.0)


class Figure(NamedTuple):
    """A figure of every run: of which setting, of which estimator, and how it is read off its runs."""

    setting: str
    read: Callable[[Runs], Float]
    estimator: str = FILTER


@dataclass(frozen=True)
class Claim:
    """A conclusion of the practical: that `figure` over every one of `others` lies in the range `asserted`.

    Attributes:
        id: short name.
        section: of the practical.
        claim: its sentence in a few words of ours.
        hypothesis: the same as a statement about a ratio.
        figure: the ratio's numerator.
        others: its denominators; with several, the one that suits the claim least decides.
        asserted: the range of the ratio, both ends excluded.
        limit: the factor by which a run counts as off at most; near what single runs can differ by.
    """

    id: str
    section: str
    claim: str
    hypothesis: str
    figure: Figure
    others: tuple[Figure, ...]
    asserted: tuple[float, float]
    limit: float = LIMIT


def ate(setting: str, estimator: str = FILTER) -> Figure:
    """RMS position error over the path."""
    return stored(setting, "ate_m", estimator)


def stored(setting: str, key: str, estimator: str = FILTER) -> Figure:
    """A figure that the study has stored."""

    def read(runs: Runs) -> Float:
        return runs.figures[key]

    return Figure(setting, read, estimator)


def landmarks_found(setting: str) -> Figure:
    """Landmarks that a mapped one stands for; half a landmark for none, as ratios are compared by logarithms."""

    def read(runs: Runs) -> Float:
        return np.maximum(runs.figures["landmarks_true"] - runs.figures["landmarks_missed"], 0.5)

    return Figure(setting, read)


def during(setting: str, what: str, first: float, last: float) -> Figure:
    """RMS position `error` or `sigma` in a stretch of the first of two loops, as shares of the loop."""

    def read(runs: Runs) -> Float:
        squares = runs.series[f"{what}_x"] ** 2 + runs.series[f"{what}_y"] ** 2
        loop = (squares.shape[1] - 1) / 2
        return np.sqrt(squares[:, round(first * loop) : round(last * loop) + 1].mean(axis=1))

    return Figure(setting, read)


def start(what: str) -> Figure:
    """The first tenth of the loop."""
    return during("q1-long-dense", what, 0.0, 0.1)


def halfway(what: str) -> Figure:
    """The tenth around the far side of the loop."""
    return during("q1-long-dense", what, 0.45, 0.55)


def back(what: str) -> Figure:
    """The tenth around the return to the start."""
    return during("q1-long-dense", what, 0.95, 1.05)


def sigma(setting: str) -> Figure:
    """RMS position sigma that the filter reports."""
    return Figure(setting, reported_sigma)


CLAIMS = (
    Claim(
        "q1-near-landmarks-error",
        "2.1",
        "landmarks near the start are better localised than far ones",
        "error of the far half of the map / of the near half > 1",
        stored("q1-long-dense", "landmark_error_far_m"),
        (stored("q1-long-dense", "landmark_error_near_m"),),
        MORE,
    ),
    Claim(
        "q1-near-landmarks-sigma",
        "2.1",
        "their uncertainty is smaller",
        "sigma of the far half of the map / of the near half > 1",
        stored("q1-long-dense", "landmark_sigma_far_m"),
        (stored("q1-long-dense", "landmark_sigma_near_m"),),
        MORE,
        limit=FIRM,
    ),
    Claim(
        "q1-error-grows",
        "2.1",
        "the error accumulates along the loop",
        "position error halfway round / near the start > 1",
        halfway("error"),
        (start("error"),),
        MORE,
    ),
    Claim(
        "q1-sigma-grows",
        "2.1",
        "so does the uncertainty",
        "position sigma halfway round / near the start > 1",
        halfway("sigma"),
        (start("sigma"),),
        MORE,
        limit=FIRM,
    ),
    Claim(
        "q1-error-falls",
        "2.1",
        "the error is corrected at the start point",
        "position error at the closure / halfway round < 1",
        back("error"),
        (halfway("error"),),
        LESS,
    ),
    Claim(
        "q1-sigma-falls",
        "2.1",
        "so is the uncertainty",
        "position sigma at the closure / halfway round < 1",
        back("sigma"),
        (halfway("sigma"),),
        LESS,
        limit=FIRM,
    ),
    Claim(
        "q1-sparse-error",
        "2.1",
        "on the sparse map the error is big",
        f"ATE on the sparse map / on the dense one > {MUCH:g}",
        ate("q1-long-sparse"),
        (ate("q1-long-dense"),),
        (MUCH, math.inf),
    ),
    Claim(
        "q2-gate-1-landmarks",
        "2.2",
        "a gate that is too small maps more landmarks than there are",
        "landmarks mapped / there, at gate 1 > 1",
        stored("q2-gate-1", "landmarks_mapped"),
        (stored("q2-gate-1", "landmarks_true"),),
        MORE,
    ),
    Claim(
        "q2-gate-100-landmarks",
        "2.2",
        "a gate that is too large ignores some landmarks",
        "landmarks found / there, at gate 100 < 1",
        landmarks_found("q2-gate-100"),
        (stored("q2-gate-100", "landmarks_true"),),
        LESS,
        limit=1.1,  # of 37 landmarks one or two are missing
    ),
    Claim(
        "q2-gate-100-error",
        "2.2",
        "and multiplies the error",
        f"ATE at gate 100 / at gate 9 > {MUCH:g}",
        ate("q2-gate-100"),
        (ate("q2-long-dense"),),
        (MUCH, math.inf),
    ),
    *(
        Claim(
            f"q2-like-known-{name}",
            "2.2",
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
        "2.2",
        "with too few landmarks it does not",
        f"ATE with gate 9 / with known association > {SAME:g}",
        ate("q2-long-sparse"),
        (ate("q1-long-sparse"),),
        (SAME, math.inf),
    ),
    Claim(
        "q3-scale-0.1-landmarks",
        "3.1",
        "with Q and Py too small, landmarks are misidentified",
        "landmarks mapped / there, at scale 0.1 > 1",
        stored("q3-scale-0.1", "landmarks_mapped"),
        (stored("q3-scale-0.1", "landmarks_true"),),
        MORE,
    ),
    Claim(
        "q3-scale-0.1-error",
        "3.1",
        "and the error is really big",
        f"ATE at scale 0.1 / the optimum's > {LARGE:g}",
        ate("q3-scale-0.1"),
        (ate("q3-scale-0.1", OPTIMUM),),
        (LARGE, math.inf),
    ),
    Claim(
        "q3-scale-1-error",
        "3.1",
        "with the true noise the error is smaller",
        "ATE at scale 1 / at scale 0.1 < 1",
        ate("q3-scale-1"),
        (ate("q3-scale-0.1"),),
        LESS,
    ),
    Claim(
        "q3-scale-10-error",
        "3.1",
        "with ten times the noise it is smaller still",
        "ATE at scale 10 / at scale 1 < 1",
        ate("q3-scale-10"),
        (ate("q3-scale-1"),),
        LESS,
    ),
    Claim(
        "q3-scale-10-sigma",
        "3.1",
        "but the uncertainty is very big",
        f"reported sigma at scale 10 / at scale 1 > {MUCH:g}",
        sigma("q3-scale-10"),
        (sigma("q3-scale-1"),),
        (MUCH, math.inf),
        limit=FIRM,
    ),
    Claim(
        "q3-scale-2-best",
        "3.1",
        "the best choice is twice the noise",
        "ATE at scale 2 / at each of 0.1, 1 and 10 < 1",
        ate("q3-scale-2"),
        (ate("q3-scale-0.1"), ate("q3-scale-1"), ate("q3-scale-10")),
        LESS,
    ),
)

TESTS = sum(len(claim.others) for claim in CLAIMS)  # ratios that are looked at
