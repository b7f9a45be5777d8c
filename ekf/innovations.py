"""Innovations of a log by the right-invariant filter (`riekf`), and their likelihood."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import NONE, allocate_belief, allocate_workspace
from slamgauge.ekf.kernels.log_likelihood import Measured, Order, Rows, run_log
from slamgauge.ekf.maps.correction_table import BLOCK
from slamgauge.ekf.maps.input_checks import start_of
from slamgauge.errors import UserError
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
        self._code = SENSORS[recording.sensor].code
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
        _, start, cov = start_of(self._recording.prior_mean, self._recording.prior_cov)
        belief.state[:3] = start
        belief.cov[:3, :3] = cov
        count = len(self._kept)
        rows = Rows(*np.zeros((3, 2 * count)))
        kept = (odometry, odometry_cov, observation[self._kept], observation_cov[self._kept])
        measured = Measured(self._code, *(np.array(each, order="C") for each in kept))  # kernels need C order
        if run_log(belief, self._order, measured, self._work, rows) != NONE:
            return None
        found = np.full((3, len(observation), 2), np.nan)
        found[2] = 0.0
        found[:, self._kept] = np.stack(rows).reshape(3, count, 2)
        found[:2, found[1] == 0.0] = np.nan
        return Innovations(*found)


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
