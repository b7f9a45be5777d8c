"""Innovations of a log by the right-invariant filter (`riekf`), and their likelihood.

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
from slamgauge.ekf.kernels.belief import Belief, Workspace, allocate_belief, allocate_workspace, resized
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.update import update_blocks
from slamgauge.ekf.maps.correction_table import BLOCK
from slamgauge.ekf.maps.input_checks import start_of
from slamgauge.errors import UserError
from slamgauge.jit import kernel
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS


class Innovations(NamedTuple):
    """Two rows for every observation, in the order of the recording; NaN for a row without information.

    Each row is conditioned on all rows before it. With the right noise, the normalised innovations are independent with
    mean 0 and variance 1.
    """

    value: Float  # (M, 2) [m or rad]
    variance: Float  # (M, 2)
    log_likelihood: Float  # (M, 2); 0 for a row without information


class Order(NamedTuple):
    """Step and landmark of each observation of a log; slots are numbered by first observation."""

    first: Int  # (N+2,) index of each step's first observation; observations of new landmarks are last in their step
    new: Int  # (N+1,) index of each step's first observation of a new landmark
    slots: Int  # (M,)


class Measured(NamedTuple):
    """Measurements with their assumed noise."""

    sensor: int  # see `slamgauge.formula_kernels`
    increment: Float  # (N, 3) body frame [m, m, rad]
    increment_cov: Float  # (N, 3, 3)
    observation: Float  # (M, 2)
    observation_cov: Float  # (M, 2, 2)


class Log:
    """A recording prepared for many filter runs with different noise.

    Args:
        recording: with ids; `range-bearing` or `position`.

    Raises:
        UserError: no ids, or a bearing-only sensor.
    """

    def __init__(self, recording: Recording) -> None:
        if recording.landmark is None:
            raise UserError("landmark: a log without ids; associate it first (Recording.associated)")
        if not SENSORS[recording.sensor].places_landmarks:
            raise UserError("sensor: a first bearing does not place a landmark; give ranges too")
        self._recording = recording
        self._kept, self._order = _ordered(recording.observation_step, recording.landmark, recording.steps)
        self._landmarks = int(self._order.slots.max(initial=-1)) + 1
        most = int(np.diff(self._order.first).max(initial=0))
        self._work = allocate_workspace(most, 3 + 2 * self._landmarks, BLOCK)

    def innovations(
        self, odometry: Float, odometry_cov: Float, observation: Float, observation_cov: Float
    ) -> Innovations | None:
        """Filter the log with these increments (N, 3), observations (M, 2) and covariances.

        Returns:
            The innovations; None if no update exists: an innovation covariance is not positive definite.
        """
        belief = allocate_belief(self._landmarks)
        _, belief.state[:3], belief.cov[:3, :3] = start_of(self._recording.prior_mean, self._recording.prior_cov)
        kept = (odometry, odometry_cov, observation[self._kept], observation_cov[self._kept])
        code = SENSORS[self._recording.sensor].code
        measured = Measured(code, *(np.array(each, order="C") for each in kept))  # kernels need C order
        whitened, pivots = np.zeros((2, len(self._kept), 2))
        if not _run(belief, self._order, measured, self._work, whitened, pivots):
            return None
        pivots[pivots == 0.0] = np.nan  # rows without information
        found = np.full((3, len(observation), 2), np.nan)
        found[0, self._kept] = whitened * pivots
        found[1, self._kept] = pivots**2
        found[2, self._kept] = -0.5 * (np.log(2.0 * np.pi * pivots**2) + whitened**2)
        return Innovations(found[0], found[1], np.nan_to_num(found[2]))


def _ordered(steps: Int, ids: Int, last_step: int) -> tuple[Int, Order]:
    """Return the rows (M',) of the used observations and their order: in every step mapped landmarks, then new ones.

    Further observations of a landmark in its first step are not used.
    """
    _, first_sight, landmark = np.unique(ids, return_index=True, return_inverse=True)
    new = np.zeros(len(ids), dtype=bool)
    new[first_sight] = True
    again = ~new & (steps == steps[first_sight][landmark])
    slot_of = np.empty(len(first_sight), dtype=np.int64)
    slot_of[np.argsort(first_sight)] = np.arange(len(first_sight))
    kept = np.lexsort((new, steps))  # stable: new landmarks stay in the order of their slots
    kept = kept[~again[kept]]
    first = np.searchsorted(steps[kept], np.arange(last_step + 2))
    many_new = np.bincount(steps[kept], weights=new[kept], minlength=last_step + 1).astype(np.int64)
    return kept, Order(first, first[1:] - many_new, slot_of[landmark[kept]])


@kernel
def _run(belief: Belief, order: Order, measured: Measured, work: Workspace, whitened: Float, pivots: Float) -> bool:
    """Filter the log; return False if a prediction or update does not exist.

    The belief contains the prior and has capacity for all landmarks. For each row with information, `whitened` (M, 2)
    receives the innovation divided by its standard deviation, both conditional on all earlier rows, and `pivots` (M, 2)
    this standard deviation: the elimination of S = U'U computes them as U'^-1 v and the diagonal of U.
    """
    sensor = measured.sensor
    for step in range(len(order.new)):
        if step > 0 and not predict(belief, measured.increment[step - 1], measured.increment_cov[step - 1]):
            return False
        start, new, end = order.first[step], order.new[step], order.first[step + 1]
        for i in range(new - start):
            work.slots[i] = order.slots[start + i]
            for a in range(2):
                work.observation[i, a] = measured.observation[start + i, a]
                for b in range(2):
                    work.observation_cov[i, a, b] = measured.observation_cov[start + i, a, b]
        if new > start and not math.isfinite(update_blocks(sensor, belief, new - start, True, work)[0]):
            return False
        for k in range(2 * (new - start)):
            if work.jacobian[k, 3] != 0.0 or work.jacobian[k, 4] != 0.0:  # has information
                whitened[start + k // 2, k % 2] = work.innovation[k]
                pivots[start + k // 2, k % 2] = work.pivots[k]
        if end > new:
            augment(sensor, belief, measured.observation[new:end], measured.observation_cov[new:end])
            belief = resized(belief, belief.size + 2 * (end - new))
    return True
