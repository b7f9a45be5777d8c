"""A whole log of known association by the right-invariant filter, and the likelihood of its innovations, compiled.

The prediction-error decomposition (Schweppe, IEEE Transactions on Information Theory 11(1), 1965): the likelihood of
all observations is the product of those of each given all before it, which are the filter's innovations. A landmark's
first sight maps it and carries no likelihood.
"""

from __future__ import annotations

from typing import NamedTuple

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.belief import Belief, resized
from slamgauge.ekf.kernels.blas import combine_rows, solve_factor, subtract_gram
from slamgauge.ekf.kernels.corrections import retract_right_invariant
from slamgauge.ekf.kernels.covariance import innovation_covariance, mirror_robot_block, project_covariance
from slamgauge.ekf.kernels.linearisation import linearise, subtract_projection
from slamgauge.ekf.kernels.outlier_likelihood import Rows, Run, Tails, continued, factor_weighing, longest_run
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.rounding_limits import are_variances_lost
from slamgauge.ekf.kernels.workspace import BLOCK_CORRECTION, CORRECTION, Workspace
from slamgauge.jit import kernel

WHOLE = -1


class Order(NamedTuple):
    """Which observations of a log belong to which step and landmark; slots are numbered by first sight."""

    first: Int  # (N+2,) where the observations of each step begin: of mapped landmarks, then of new ones
    new: Int  # (N+1,) where those of new ones begin
    slots: Int  # (M,)


class Measured(NamedTuple):
    """What was measured, with the noise that is assumed of it."""

    increment: Float  # (N, 3) body frame [m, m, rad]
    increment_cov: Float  # (N, 3, 3)
    observation: Float  # (M, 2)
    observation_cov: Float  # (M, 2, 2)


@kernel
def run_log(
    sensor: int, belief: Belief, order: Order, measured: Measured, tails: Tails, work: Workspace, rows: Rows
) -> int:
    """Filter the log and fill `rows`; the step at which no update exists, WHOLE if there is none.

    The belief holds the prior, and has room for all landmarks.
    """
    run, longest = Run(0, -1), longest_run(tails)
    for step in range(len(order.new)):
        if step > 0 and not predict(belief, measured.increment[step - 1], measured.increment_cov[step - 1]):
            return step
        start, new, end = order.first[step], order.new[step], order.first[step + 1]
        if new > start:
            _load(order, measured, start, new, work)
            if not _take_in(sensor, belief, new - start, tails, run.length >= longest, work, rows, start):
                return step
            run = continued(run, order.slots, rows, start, new)
        if end > new:
            _load(order, measured, new, end, work)
            augment(sensor, belief, end - new, work)
            belief = resized(belief, belief.size + 2 * (end - new))
    return WHOLE


@kernel
def _load(order: Order, measured: Measured, start: int, end: int, work: Workspace) -> None:
    """Put observations start..end into the workspace."""
    for i in range(start, end):
        k = i - start
        work.slots[k] = order.slots[i]
        for a in range(2):
            work.observation[k, a] = measured.observation[i, a]
            for b in range(2):
                work.observation_cov[k, a, b] = measured.observation_cov[i, a, b]


@kernel
def _take_in(
    sensor: int, belief: Belief, count: int, tails: Tails, is_lost: bool, work: Workspace, rows: Rows, start: int
) -> bool:
    """Correct with the first `count` observations of the workspace, weighed; False if no update exists.

    `take_in` and `update_right_invariant` with a weight for every row, which `rows` takes from observation `start` on.
    """
    linearise(sensor, belief, work.slots[:count], work.observation, work.innovation, work.jacobian)
    size, dx, block_dx = belief.size, work.scratch[CORRECTION], work.scratch[BLOCK_CORRECTION]
    dx[:size] = 0.0
    block = len(work.W) // 2
    for first in range(0, count, block):
        last = min(first + block, count)
        slots, jacobian = work.slots[first:last], work.jacobian[2 * first : 2 * last]
        subtract_projection(dx, first, last, work)
        project_covariance(belief.cov, size, slots, jacobian, work.W)
        innovation_covariance(work.W, slots, jacobian, work.observation_cov[first:last], work.S)
        y, height = work.innovation[2 * first : 2 * last], 2 * (last - first)
        if not factor_weighing(work.S, y, jacobian, tails, is_lost, rows, 2 * (start + first)):
            return False
        solve_factor(work.S, work.W, height, size)
        if are_variances_lost(belief.cov, slots, work.W, height):
            return False
        combine_rows(work.W, y, block_dx, height, size)
        for j in range(size):
            dx[j] += block_dx[j]
        subtract_gram(belief.cov, work.W, height, size)
        mirror_robot_block(belief.cov)
    retract_right_invariant(belief, work)
    return True
