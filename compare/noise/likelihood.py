"""Likelihood of a noise model, its maximum, and profile likelihood intervals.

Gradient and information are computed from differences of whole runs of the filter. With Gaussian errors the information
is Fisher's, sum (d e d e' / v + d log v d log v' / 2) over conditional innovations e with variances v. With outliers it
is the sum of the outer products of each row's gradient (Berndt, Hall, Hall and Hausman 1974), for any distribution.

An interval contains the values of a parameter at which twice the log-likelihood, maximised over all others, is at most
3.84 below its maximum. The search for an end (Venzon and Moolgavkar, Applied Statistics 37(1), 1988) goes repeatedly to
the end in the quadratic model at the newest point.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.ekf.innovations import Innovations

DIFFERENCE = 1e-4  # step of differences; the gradient's error is about 1e-3 of its random variation
RIDGE = 0.1  # added information, which keeps a parameter that the log does not determine at its place
ITERATIONS = 30  # largest number; a Gaussian log needs about 5
FLAT = 0.1  # length of the gradient at the maximum
CRITICAL = 3.841  # 95 % quantile of chi-square with 1 degree of freedom
FAR = 6.0  # distance from the maximum (a factor of 400) beyond which an interval has no end
LONGEST = 1.5  # longest step towards an end
STEPS = 12  # largest number of steps towards an end
CLOSE = 0.02  # length of the last step, relative to the distance from the maximum


class Local(NamedTuple):
    """Quadratic model of the log-likelihood at a point."""

    gradient: Float  # (P,)
    information: Float  # (P, P) minus the curvature, positive semi-definite


class Interval(NamedTuple):
    """A value with its 95 % profile likelihood interval.

    An end that the log does not determine is infinite. The low end of a sigma is 0 if all smaller values are as likely.
    """

    value: float
    low: float
    high: float


class Likelihood:
    """Log-likelihood of a noise model at points (P,), with derivatives; the last point is stored."""

    def __init__(self, model: NoiseModel) -> None:
        self.model = model
        self._point: Float = np.zeros(0)
        self._innovations: Innovations | None = None
        self._local: Local | None = None

    def innovations(self, point: Float) -> Innovations | None:
        """Return the innovations at a point; None if the filter cannot compute an update."""
        if not np.array_equal(self._point, point):
            self._point, self._local = point.copy(), None
            self._innovations = self.model.innovations(self.model.values(point))
        return self._innovations

    def value(self, point: Float) -> float:
        """Return the log-likelihood; minus infinity if the filter cannot compute an update."""
        found = self.innovations(point)
        return -math.inf if found is None else float(found.log_likelihood.sum())

    def local(self, point: Float) -> Local:
        """Return gradient and information at a point."""
        found = self.innovations(point)
        if self._local is None:
            self._local = self._differentiate(point, found)
        return self._local

    def _differentiate(self, point: Float, found: Innovations | None) -> Local:
        count = len(point)
        if found is None:
            return Local(np.zeros(count), np.eye(count))
        scores, errors, widths = [], [], []
        for place in range(count):
            moved = point.copy()
            moved[place] += DIFFERENCE
            there = self.model.innovations(self.model.values(moved)) or found
            scores.append((there.log_likelihood - found.log_likelihood).ravel() / DIFFERENCE)
            errors.append(((there.value - found.value) / np.sqrt(found.variance)).ravel() / DIFFERENCE)
            widths.append(np.log(there.variance / found.variance).ravel() / DIFFERENCE)
        rows = np.stack(scores)
        if self.model.distributions:
            return Local(rows.sum(axis=1), rows @ rows.T)
        e, w = np.nan_to_num(errors), np.nan_to_num(widths)
        return Local(rows.sum(axis=1), e @ e.T + 0.5 * w @ w.T)

    def maximum(self, start: Float, iterations: int = ITERATIONS) -> Float:
        """Return the maximum from `start` on, or the last point if `iterations` do not suffice."""
        from scipy.optimize import minimize  # slow to import, and figures do not need it

        def cost(point: Float) -> float:
            return -self.value(point)

        def gradient(point: Float) -> Float:
            return -self.local(point).gradient

        def curvature(point: Float) -> Float:
            return self.local(point).information + RIDGE * np.eye(len(start))

        found = minimize(
            cost,
            start,
            jac=gradient,
            hess=curvature,
            method="trust-exact",
            options={"gtol": FLAT, "initial_trust_radius": 1.0, "max_trust_radius": 2.0, "maxiter": iterations},
        )
        return np.asarray(found.x)


def intervals(likelihood: Likelihood, best: Float, names: Iterable[str]) -> dict[str, Interval]:
    """Return the 95 % intervals of some parameters about the maximum `best` (P,), in their units."""
    model, top, local, found = likelihood.model, likelihood.value(best), likelihood.local(best), dict[str, Interval]()
    for name in names:
        place = model.names.index(name)
        low, high = (_end(likelihood, best, top, local, place, side) for side in (-1, 1))
        found[name] = Interval(*(model.value(name, each) for each in (float(best[place]), low, high)))
    return found


def _end(likelihood: Likelihood, best: Float, top: float, local: Local, place: int, side: int) -> float:
    """Return the end of an interval on one `side` of the maximum, where the log-likelihood is `top`."""
    point, deviance = best, 0.0
    for _ in range(STEPS):
        step = _step_to_end(deviance, local, place, side)
        if abs(step[place]) > LONGEST:
            step *= LONGEST / abs(step[place])
        ahead = side * (point[place] + step[place] - best[place])
        if deviance > 0.0 and abs(step[place]) < CLOSE * ahead:
            return float(point[place] + step[place])
        if ahead > FAR:
            break
        point = point + step
        deviance, local = 2.0 * (top - likelihood.value(point)), likelihood.local(point)
        if not math.isfinite(deviance):
            break
    return side * math.inf


def _step_to_end(deviance: float, local: Local, place: int, side: int) -> Float:
    """Return the step (P,) to the end in the quadratic model at a point with the given deviance from the maximum.

    The deviance after a step s is D - 2 g's + s'Hs. Its minimum over the other entries o is at s_o = H_oo^-1 (g_o -
    H_oa s_a), which leaves a quadratic in s_a. If it does not reach CRITICAL, the step goes to its minimum.
    """
    others = np.delete(np.arange(len(local.gradient)), place)
    H = local.information + RIDGE * np.eye(len(local.gradient))
    g = local.gradient
    solved = np.linalg.solve(H[np.ix_(others, others)], np.column_stack([g[others], H[others, place]]))
    reduced = deviance - g[others] @ solved[:, 0] - CRITICAL
    slope = g[place] - H[place, others] @ solved[:, 0]
    curvature = H[place, place] - H[place, others] @ solved[:, 1]
    root = math.sqrt(max(slope**2 - curvature * reduced, 0.0))
    step = np.zeros(len(g))
    step[place] = (slope + side * root) / curvature
    step[others] = solved[:, 0] - solved[:, 1] * step[place]
    return step
