"""Likelihood of a log with known association, from the innovations of the right-invariant filter, compiled.

Prediction-error decomposition (Schweppe, IEEE Transactions on Information Theory 11(1), 1965): the likelihood of all
observations is the product of the likelihood of each observation given all earlier ones, which is the likelihood of its
innovation. The first observation of a landmark maps it and has no likelihood.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.belief import NONE, Belief, Pending, Workspace, resized
from slamgauge.ekf.kernels.blas import combine_rows, solve_factor
from slamgauge.ekf.kernels.covariance import innovation_covariance, project_covariance
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.precision import are_variances_lost
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.update import apply, retract
from slamgauge.jit import inner, kernel

HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class Order(NamedTuple):
    """Step and landmark of each observation of a log; slots are numbered by first observation."""

    first: Int  # (N+2,) index of each step's first observation; observations of new landmarks are last in their step
    new: Int  # (N+1,) index of each step's first observation of a new landmark
    slots: Int  # (M,)


class Measured(NamedTuple):
    """Measurements with their assumed noise."""

    sensor: int  # see `slamgauge.sensor_kernels`
    increment: Float  # (N, 3) body frame [m, m, rad]
    increment_cov: Float  # (N, 3, 3)
    observation: Float  # (M, 2)
    observation_cov: Float  # (M, 2, 2)


class Rows(NamedTuple):
    """Results of every row of every observation; rows without information have variance 0 and likelihood 0."""

    innovation: Float  # (2M,) e, conditional on all earlier rows [m or rad]
    variance: Float  # (2M,) v
    log_likelihood: Float  # (2M,) of e in N(0, v)


@kernel
def run_log(belief: Belief, order: Order, measured: Measured, work: Workspace, rows: Rows) -> int:
    """Filter the log and fill `rows`; return NONE, or the step at which no prediction or update exists.

    The belief contains the prior and has capacity for all landmarks.
    """
    sensor = measured.sensor
    for step in range(len(order.new)):
        if step > 0 and not predict(belief, measured.increment[step - 1], measured.increment_cov[step - 1]):
            return step
        start, new, end = order.first[step], order.new[step], order.first[step + 1]
        if new > start:
            _load(order, measured, start, new, work)
            if not _update(sensor, belief, work, _rows_between(rows, start, new)):
                return step
        if end > new:
            augment(sensor, belief, measured.observation[new:end], measured.observation_cov[new:end])
            belief = resized(belief, belief.size + 2 * (end - new))
    return NONE


@inner
def _load(order: Order, measured: Measured, start: int, end: int, work: Workspace) -> None:
    """Copy observations start..end into the workspace."""
    for i in range(start, end):
        k = i - start
        work.slots[k] = order.slots[i]
        for a in range(2):
            work.observation[k, a] = measured.observation[i, a]
            for b in range(2):
                work.observation_cov[k, a, b] = measured.observation_cov[i, a, b]


@inner
def _rows_between(rows: Rows, start: int, end: int) -> Rows:
    """Return the rows of observations start..end, as views."""
    part = slice(2 * start, 2 * end)
    return Rows(rows.innovation[part], rows.variance[part], rows.log_likelihood[part])


@inner
def _update(sensor: int, belief: Belief, work: Workspace, rows: Rows) -> bool:
    """Correct with the first observations of `work` and fill their `rows`; return False if no update exists.

    Does the same as `update.update`, with a likelihood for every row.
    """
    count = len(rows.innovation) // 2
    linearise(sensor, belief, work.slots[:count], work.observation, work.innovation, work.jacobian)
    size, block = belief.size, len(work.S) // 2
    dx, block_dx = np.zeros(size), np.empty(size)
    for first in range(0, count, block):
        last = min(first + block, count)
        slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
        y, height = work.innovation[2 * first : 2 * last], 2 * (last - first)
        subtract_projection(dx, slots, jacobian, y)
        project_covariance(belief.cov, size, slots, jacobian, work.W)
        innovation_covariance(work.W, slots, jacobian, work.observation_cov[first:last], work.S)
        if not _factor(work.S, y, jacobian, _rows_between(rows, first, last)):
            return False
        solve_factor(work.S, work.W, height, size)
        changed = Pending(height, 0)
        if are_variances_lost(belief.cov, slots, changed, work):
            return False
        combine_rows(work.W, y, block_dx, height, size)
        for j in range(size):
            dx[j] += block_dx[j]
        apply(belief, changed, work)
    retract(belief, dx, True, work)
    return True


@inner
def _factor(S: Float, y: Float, jacobian: Float, rows: Rows) -> bool:
    """Factor S = U'U in place, y <- U'^-1 y, and fill the `rows` of y; return False if S is not positive definite.

    The rows are processed in order, each conditioned on all earlier rows: the elimination computes the conditional
    innovation e, and its pivot is the conditional variance v of e. Uses the upper triangle of the first len(y) rows.
    """
    count = len(y)
    for a in range(count):
        for b in range(a):
            y[a] -= S[b, a] * y[b]
        variance, e = S[a, a], y[a]
        if not (variance > 0.0 and math.isfinite(variance + e)):
            return False
        if jacobian[a, 3] != 0.0 or jacobian[a, 4] != 0.0:  # has information
            rows.innovation[a], rows.variance[a] = e, variance
            rows.log_likelihood[a] = -0.5 * (math.log(variance) + e * e / variance) - HALF_LOG_TWO_PI
        root = math.sqrt(variance)
        y[a] = e / root
        S[a, a] = root
        for c in range(a + 1, count):
            S[a, c] /= root
        for b in range(a + 1, count):
            for c in range(b, count):
                S[b, c] -= S[a, b] * S[a, c]
    return True
