"""The likelihood of a noise model, and its maximum.

The gradient is by differences of whole runs of the filter, and so is the information: of the conditional innovations e
with variances v, sum (d e d e' / v + d log v d log v' / 2) (Fisher's, given the path), and with outliers the sum of the
outer products of each row's gradient (Berndt, Hall, Hall and Hausman 1974), which needs no law.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.ekf.innovations import Innovations

DIFFERENCE = 1e-4  # of a parameter: errors of the gradient are smaller than its chance by some 1e-3
RIDGE = 0.1  # information lent to a parameter of which the log says nothing, so that it stays where it is
ITERATIONS = 30  # at most; a Gaussian log takes some 5
FLAT = 0.1  # length of a gradient at the maximum


class Local(NamedTuple):
    """The log-likelihood about a point."""

    gradient: Float  # (P,)
    information: Float  # (P, P) minus its curvature, positive semi-definite


class Likelihood:
    """Twice differentiable by runs of the filter, of which none is made twice."""

    def __init__(self, model: NoiseModel) -> None:
        self.model = model
        self._at: Float = np.zeros(0)
        self._found: Innovations | None = None
        self._local: Local | None = None
        self._top: Local | None = None

    def at(self, parameters: Float) -> Innovations | None:
        """The innovations at these parameters."""
        if not np.array_equal(self._at, parameters):
            self._at, self._found, self._local = parameters.copy(), self.model.innovations(parameters), None
        return self._found

    def value(self, parameters: Float) -> float:
        """The log-likelihood; minus infinity where the filter has no update."""
        found = self.at(parameters)
        return -math.inf if found is None else float(found.log_likelihood.sum())

    def local(self, parameters: Float) -> Local:
        """Gradient and information."""
        found = self.at(parameters)
        if self._local is None or found is None:
            self._local = self._differentiate(parameters, found)
        return self._local

    def top(self, best: Float) -> Local:
        """The same at the maximum, kept: every interval begins there."""
        if self._top is None:
            self._top = self.local(best)
        return self._top

    def _differentiate(self, parameters: Float, found: Innovations | None) -> Local:
        count = len(parameters)
        if found is None:
            return Local(np.zeros(count), np.eye(count))
        scores, errors, widths = [], [], []
        for place in range(count):
            moved = parameters.copy()
            moved[place] += DIFFERENCE
            there = self.model.innovations(moved) or found
            scores.append((there.log_likelihood - found.log_likelihood).ravel() / DIFFERENCE)
            errors.append(((there.value - found.value) / np.sqrt(found.variance)).ravel() / DIFFERENCE)
            widths.append(np.log(there.variance / found.variance).ravel() / DIFFERENCE)
        rows = np.stack(scores)
        if self.model.laws:
            return Local(rows.sum(axis=1), rows @ rows.T)
        e, w = np.nan_to_num(errors), np.nan_to_num(widths)
        return Local(rows.sum(axis=1), e @ e.T + 0.5 * w @ w.T)

    def maximum(self, start: Float, iterations: int = ITERATIONS) -> Float:
        """Where it is largest, from `start` on, or as near as that many iterations come."""
        from scipy.optimize import minimize  # here: slow to start, and figures need this module's names alone

        def cost(parameters: Float) -> float:
            return -self.value(parameters)

        def gradient(parameters: Float) -> Float:
            return -self.local(parameters).gradient

        def curvature(parameters: Float) -> Float:
            return self.local(parameters).information + RIDGE * np.eye(len(start))

        found = minimize(
            cost,
            start,
            jac=gradient,
            hess=curvature,
            method="trust-exact",
            options={"gtol": FLAT, "initial_trust_radius": 1.0, "max_trust_radius": 2.0, "maxiter": iterations},
        )
        return np.asarray(found.x)
