"""A map: its state, and prediction and update by the compiled kernels of a rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import Workspace, allocate_workspace
from slamgauge.ekf.kernels.linear_update import linear_update
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.slots import find_slots
from slamgauge.ekf.kernels.update import Form, are_sound, retract, update
from slamgauge.ekf.maps.correction_table import Correction, Rule, rule_of
from slamgauge.ekf.maps.input_checks import explain_increment, explain_scan, load_increment, require_sensor, why_not
from slamgauge.ekf.maps.map_state import MapState
from slamgauge.errors import UserError
from slamgauge.jit import direct
from slamgauge.sensors import SENSORS


class Kernels(NamedTuple):
    """Machine code of a step; `slamgauge bench` replaces it by timed functions."""

    predict: Callable[..., bool]
    find_slots: Callable[..., int]
    update: Callable[..., tuple[float, int]]


class LandmarkMap:
    """Robot and landmarks, with their prediction and update.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: name or rule; see `correction_table`.
        landmarks: initial capacity; the map grows as needed.
        tails: degrees of freedom of the observations' noise (see `kernels.linearisation`).

    Attributes:
        state: belief, ids and slots.
        correction: prediction and update.

    Raises:
        UserError: an unknown sensor or correction, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction | Rule,
        landmarks: int,
        tails: float = math.inf,
    ) -> None:
        require_sensor(sensor, tuple(SENSORS))
        rule = rule_of(correction)
        self.state = MapState(prior_mean, prior_cov, rule, landmarks)
        self.correction = MapCorrection(self.state, sensor, rule, tails)


class MapCorrection:
    """Prediction and update of a map by a rule.

    Args:
        state: the map.
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        rule: kernels of a step.
        tails: degrees of freedom of the observations' noise (see `kernels.linearisation`).

    Attributes:
        code: number of the sensor in kernels.
        dim: columns d of an observation.
    """

    def __init__(self, state: MapState, sensor: str, rule: Rule, tails: float) -> None:
        self.sensor = sensor
        self.code, self.dim = SENSORS[sensor].code, SENSORS[sensor].dim
        self.rule = rule
        self.form: Form = rule.form._replace(tails=tails)
        self._state = state
        self._increment = np.zeros(3)
        self._increment_cov = np.zeros((3, 3))
        self._work = allocate_workspace(0, state.capacity, rule.block)
        self._compile()

    def _compile(self) -> None:
        """Get the machine code of a step for the types of these arrays."""
        ids, belief = self._state.ids, self._state.belief
        self.kernels = Kernels(
            direct(predict, belief, self._increment, self._increment_cov),
            direct(find_slots, ids, ids, self._work.ids, self._work.slots),
            direct(update, self.code, belief, 0, self.form, self._work),
        )

    def __getstate__(self) -> dict[str, object]:
        """Return all attributes without the machine code, which is valid in this process only."""
        return {key: value for key, value in vars(self).items() if key != "kernels"}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._compile()

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: wrong shapes, a number that is not finite, or an invalid covariance; nothing has changed.
        """
        load_increment(increment, cov, self._increment, self._increment_cov)
        if not self.kernels.predict(self._state.belief, self._increment, self._increment_cov):
            raise explain_increment(self._increment, self._increment_cov)

    def update_by_ids(
        self, ids: ArrayLike, values: NDArray[np.generic], covs: NDArray[np.generic]
    ) -> tuple[float, int] | None:
        """Correct with observations (m, d), (m, d, d) of the landmarks `ids` (m,).

        Return the result of `update`; or None, with nothing changed, if a landmark is not mapped.
        """
        count, state = len(values), self._state
        work = self._workspace(count)
        work.ids[:count] = ids
        if self.kernels.find_slots(state.sorted_ids, state.sorted_slots, work.ids[:count], work.slots):
            return None
        return self._update_found(work, values, covs)

    def update(self, slots: Int, values: Float, covs: Float) -> tuple[float, int]:
        """Correct with observations (m, d), (m, d, d) of the landmarks in `slots` (m,).

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without observations).

        Raises:
            UserError: no update exists; nothing has changed.
        """
        count = len(slots)
        if count == 0:
            return 0.0, 0
        work = self._workspace(count)
        work.slots[:count] = slots
        return self._update_found(work, values, covs)

    def _update_found(
        self, work: Workspace, values: NDArray[np.generic], covs: NDArray[np.generic]
    ) -> tuple[float, int]:
        """Correct with observations of the landmarks in `work.slots`."""
        count, state = len(values), self._state
        fill_rows(values, covs, work.observation, work.observation_cov)
        belief = state.belief
        nis, informative = self.kernels.update(self.code, belief, count, self.form, work)
        if not math.isfinite(nis):
            raise explain_scan(self.sensor, values, covs, nis, state.variances)
        return nis, informative

    def update_linear(self, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float) -> float:
        """Correct with innovations (r,) and their Jacobian (r, c) by the entries `columns` (c,); return the NIS.

        Raises:
            UserError: no update exists, because a number is not finite or `noise_cov` is not positive definite.
        """
        state = self._state
        found = linear_update(state.belief, columns, jacobian, innovation, noise_cov)
        if not np.isfinite(found.nis):
            remedy = "make every value finite and every covariance positive definite"
            raise UserError(f"observation: no update exists; {remedy}; {why_not(found.nis, state.variances)}")
        self.retract(found.dx)
        return found.nis

    def retract(self, dx: Float) -> None:
        """Move the state by a correction dx (size,), and transform the covariance accordingly."""
        retract(self._state.belief, dx, self.form.invariant, self._workspace(1))

    def require_sound(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> None:
        """Refuse observations (m, d), (m, d, d) that `Recording` refuses."""
        if not are_sound(self.code, *two_rows(values, covs)):
            raise explain_scan(self.sensor, values, covs, math.nan, self._state.variances)

    def loaded(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> Workspace:
        """Return the workspace with observations (m, d), (m, d, d) in its first m rows."""
        work = self._workspace(len(values))
        fill_rows(values, covs, work.observation, work.observation_cov)
        return work

    def _workspace(self, observations: int) -> Workspace:
        """Return the workspace, with room for that many observations and for the state."""
        state = self._state
        if observations > len(self._work.ids) or state.capacity > self._work.W.shape[1]:
            room = max(observations, len(self._work.ids))
            self._work = allocate_workspace(room, state.capacity, self.rule.block)
        return self._work


def two_rows(values: NDArray[np.generic], covs: NDArray[np.generic]) -> tuple[Float, Float]:
    """Return observations (m, d), (m, d, d) as kernels read them: (m, 2), (m, 2, 2); a bearing is the second row."""
    count = len(values)
    observation, observation_cov = np.zeros((count, 2)), np.empty((count, 2, 2))
    fill_rows(values, covs, observation, observation_cov)
    return observation, observation_cov


def fill_rows(
    values: NDArray[np.generic], covs: NDArray[np.generic], observation: Float, observation_cov: Float
) -> None:
    """Copy observations (m, d), (m, d, d) to the first m rows of arrays (n, 2), (n, 2, 2); see `two_rows`."""
    count = len(values)
    if values.shape[1] == 2:
        observation[:count] = values
        observation_cov[:count] = covs
    else:
        observation_cov[:count] = np.eye(2)
        observation[:count, 1:] = values
        observation_cov[:count, 1:, 1:] = covs
