"""The conclusions of the exercise, each as a ratio of two figures of the same runs and a range of that ratio."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.exercise.settings import CAUSAL, EKF
from slamgauge.compare.scoring.runs import Runs, reported_sigma

MORE, LESS = (1.0, math.inf), (0.0, 1.0)  # ranges of ratios
SAME = (1.0 / 1.1, 1.1)  # "like", "similar"
MUCH = (2.0, math.inf)  # "much", "very", "multiplies"
LARGE = (1.5, math.inf)  # "large" error: at least this factor of the optimum's
STRETCHES = {"near the start": (0.0, 0.1), "halfway round": (0.45, 0.55), "back at the start": (0.95, 1.05)}  # loops


@dataclass(frozen=True)
class Measure:
    """A figure (R,) of every run: number of the setting, name, function that reads it from the runs, and estimator."""

    figure: str
    name: str
    read: Callable[[Runs], Float]
    estimator: str = EKF

    def __str__(self) -> str:
        return f"{self.name} ({self.figure})"


@dataclass(frozen=True)
class Conclusion:
    """A conclusion of the exercise: `above` divided by each of `below` is in the range `asserted`, its ends excluded.

    `id` begins with the question; `text` is the conclusion of the exercise, shortened.
    """

    id: str
    text: str
    asserted: tuple[float, float]
    above: Measure
    below: tuple[Measure, ...]

    @property
    def question(self) -> str:
        """`q1`, `q2` or `q3`."""
        return self.id.partition("-")[0]

    @property
    def hypothesis(self) -> str:
        """The conclusion as a statement about a ratio."""
        low, high = self.asserted
        where = f"within 1/{high:g} and {high:g}"
        if low == 0.0:
            where = f"< {high:g}"
        elif high == math.inf:
            where = f"> {low:g}"
        return f"{self.above} / {', / '.join(map(str, self.below))} {where}"


def _stored(figure: str, key: str, name: str, estimator: str = EKF) -> Measure:
    """Return a figure that studies store, by its key in `scoring.catalogue`."""
    return Measure(figure, name, lambda runs: runs.figures[key], estimator)


def ate(figure: str) -> Measure:
    """Return the RMS position error over the path [m]."""
    return _stored(figure, "ate_m", "ATE")


def _found(figure: str) -> Measure:
    """Return the number of true landmarks that are mapped; 0.5 for none, because ratios have logarithms."""

    def read(runs: Runs) -> Float:
        return np.maximum(runs.figures["landmarks_true"] - runs.figures["landmarks_missed"], 0.5)

    return Measure(figure, "landmarks found", read)


def _mapped(figure: str) -> Measure:
    return _stored(figure, "landmarks_mapped", "mapped landmarks")


def _true(figure: str) -> Measure:
    return _stored(figure, "landmarks_true", "true landmarks")


def _reported(figure: str) -> Measure:
    """Return the RMS position sigma over the path [m]."""
    return Measure(figure, "reported sigma", reported_sigma)


def _half_map(what: Literal["error", "sigma"], half: Literal["near", "far"]) -> Measure:
    """Return RMS error or sigma [m] of the half of the map that is nearer to the start, or of the farther one."""
    return _stored("2.2", f"landmark_{what}_{half}_m", f"{what} of the {half} half of the map")


def during(what: Literal["error", "sigma"], stretch: str) -> Measure:
    """Return RMS position error or sigma [m] in a stretch of the first of two loops."""

    def read(runs: Runs) -> Float:
        squares = runs.series[f"{what}_x"] ** 2 + runs.series[f"{what}_y"] ** 2
        first, last = (round(share * (squares.shape[1] - 1) / 2) for share in STRETCHES[stretch])
        return np.sqrt(squares[:, first : last + 1].mean(axis=1))

    return Measure("2.2", f"position {what} {stretch}", read)


def _claim(id: str, text: str, asserted: tuple[float, float], above: Measure, *below: Measure) -> Conclusion:
    return Conclusion(id, text, asserted, above, below)


ERRORS, SIGMAS = ([during(what, stretch) for stretch in STRETCHES] for what in ("error", "sigma"))
LIKE_KNOWN = "with gate 9 the {} map looks as with known association"
CONCLUSIONS = (
    _claim(
        "q1-near-landmarks-error",
        "landmarks near the start are better localised than far ones",
        MORE,
        *(_half_map("error", half) for half in ("far", "near")),
    ),
    _claim(
        "q1-near-landmarks-sigma",
        "their uncertainty is smaller",
        MORE,
        *(_half_map("sigma", half) for half in ("far", "near")),
    ),
    _claim("q1-error-grows", "the error accumulates along the loop", MORE, ERRORS[1], ERRORS[0]),
    _claim("q1-sigma-grows", "so does the uncertainty", MORE, SIGMAS[1], SIGMAS[0]),
    _claim("q1-error-falls", "the error is corrected at the start point", LESS, ERRORS[2], ERRORS[1]),
    _claim("q1-sigma-falls", "so is the uncertainty", LESS, SIGMAS[2], SIGMAS[1]),
    _claim("q1-sparse-error", "on the sparse map the error is big", MUCH, ate("2.3"), ate("2.2")),
    _claim(
        "q2-gate-1-landmarks",
        "a gate that is too small maps more landmarks than there are",
        MORE,
        _mapped("2.4"),
        _true("2.4"),
    ),
    _claim(
        "q2-gate-100-landmarks", "a gate that is too large ignores some landmarks", LESS, _found("2.5"), _true("2.5")
    ),
    _claim("q2-gate-100-error", "and multiplies the error", MUCH, ate("2.5"), ate("2.7")),
    _claim("q2-like-known-short-dense", LIKE_KNOWN.format("short, dense"), SAME, ate("2.6"), ate("2.1")),
    _claim("q2-like-known-long-dense", LIKE_KNOWN.format("long, dense"), SAME, ate("2.7"), ate("2.2")),
    _claim("q2-unlike-known-sparse", "with too few landmarks it does not", (SAME[1], math.inf), ate("2.8"), ate("2.3")),
    _claim(
        "q3-scale-0.1-landmarks",
        "with Q and Py too small, landmarks are misidentified",
        MORE,
        _mapped("3.1"),
        _true("3.1"),
    ),
    _claim(
        "q3-scale-0.1-error",
        "and the error is really big",
        LARGE,
        ate("3.1"),
        _stored("3.1", "ate_m", f"ATE of {CAUSAL}", CAUSAL),
    ),
    _claim("q3-scale-1-error", "with the true noise the error is smaller", LESS, ate("3.2"), ate("3.1")),
    _claim("q3-scale-10-error", "with ten times the noise it is smaller still", LESS, ate("3.3"), ate("3.2")),
    _claim("q3-scale-10-sigma", "but the uncertainty is very big", MUCH, _reported("3.3"), _reported("3.2")),
    _claim("q3-scale-2-best", "the best choice is twice the noise", LESS, ate("3.4"), *map(ate, ("3.1", "3.2", "3.3"))),
)
