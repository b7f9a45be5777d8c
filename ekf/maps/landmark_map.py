"""The map of a filter: its state, with prediction, update and edits by the compiled kernels of a rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.belief import NONE, Workspace, allocate_workspace
from slamgauge.ekf.kernels.linearisation import innovations_of
from slamgauge.ekf.kernels.precision import LEAST_SHARE
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.soundness import are_sound
from slamgauge.ekf.kernels.student_t import inflate_noise
from slamgauge.ekf.kernels.update import PASSES, find_slots, retract, update, update_iterated
from slamgauge.ekf.maps.correction_table import Correction, rule_of
from slamgauge.ekf.maps.input_checks import (
    DIVERGED,
    explain_increment,
    explain_scan,
    load_increment,
    require_sensor,
    why_not,
)
from slamgauge.ekf.maps.map_state import MapState
from slamgauge.errors import UserError
from slamgauge.jit import direct
from slamgauge.notices import tell_once
from slamgauge.sensors import SENSORS

UNSETTLED = "{}: an update did not settle in {} passes, and the last one is used; raise the sensor noise"


class LandmarkMap(MapState):
    """Robot and landmarks, with prediction, update and edits.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: see `correction_table`.
        landmarks: initial capacity; the map grows as needed.
        tails: degrees of freedom of the observations' noise (see `kernels.student_t`).

    Attributes:
        code: number of the sensor in kernels.
        dim: columns d of an observation.

    Raises:
        UserError: an unknown sensor or correction, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction,
        landmarks: int = 32,
        tails: float = math.inf,
    ) -> None:
        require_sensor(sensor, tuple(SENSORS))
        self.sensor, self.rule = sensor, rule_of(correction)
        self.code, self.dim = SENSORS[sensor].code, SENSORS[sensor].dim
        self.form = self.rule.form._replace(tails=tails)
        super().__init__(prior_mean, prior_cov, self.rule, landmarks)
        self._increment, self._increment_cov = np.zeros(3), np.zeros((3, 3))
        self._work = allocate_workspace(0, len(self.belief.state), self.rule.block)

    @cached_property
    def predict_kernel(self) -> Callable[..., bool]:
        """Machine code of `prediction.predict`."""
        return direct(predict, self.belief, self._increment, self._increment_cov)

    @cached_property
    def update_kernels(self) -> tuple[Callable[..., int], Callable[..., tuple[Any, ...]]]:
        """Machine code of `update.find_slots` and of the update of the rule."""
        form, work = self.form, self._work
        found = update_iterated if form.iterated else update
        return (
            direct(find_slots, self.ids, self.ids, 0, work.ids, work.slots),
            direct(found, self.code, self.belief, 0, form.invariant, work),
        )

    def __getstate__(self) -> dict[str, object]:
        """Return all attributes without the machine code, which is valid in this process only."""
        return {key: value for key, value in vars(self).items() if "_kernel" not in key}

    def predict(self, increment: ArrayLike, cov: ArrayLike) -> None:
        """Move by a body-frame increment (3,) [m, m, rad] with covariance (3, 3).

        Raises:
            UserError: wrong shapes, a number that is not finite, or an invalid covariance; nothing has changed.
        """
        load_increment(increment, cov, self._increment, self._increment_cov)
        if not self.predict_kernel(self.belief, self._increment, self._increment_cov):
            raise explain_increment(self._increment, self._increment_cov)

    def update(
        self, ids: ArrayLike, values: NDArray[np.generic], covs: NDArray[np.generic]
    ) -> tuple[float, int] | None:
        """Correct with observations (m, d), (m, d, d) of the landmarks `ids` (m,).

        Returns:
            The normalised innovation squared and its degrees of freedom (0, 0 without observations); or None, with
            nothing changed, if a landmark is not mapped.

        Raises:
            UserError: no update exists; nothing has changed.
        """
        count = len(values)
        if count == 0:
            return 0.0, 0
        find, correct = self.update_kernels
        work = self.loaded(values, covs)
        work.ids[:count] = ids
        if find(self.sorted_ids, self.sorted_slots, count, work.ids, work.slots):
            return None
        if self.form.tails < math.inf:
            inflate_noise(self.code, self.belief, count, self.form.tails, work)
        found = correct(self.code, self.belief, count, self.form.invariant, work)
        nis = found[0]
        if not math.isfinite(nis):
            raise explain_scan(self.sensor, values, covs, nis, self.variances)
        if len(found) > 2:  # with the number of passes of the iterated filter
            self.require_settled(found[2])
        return nis, found[1]

    def require_settled(self, passes: int) -> None:
        """Print a notice, once, if an update of the iterated filter did not settle in its number of passes."""
        if passes == PASSES:
            tell_once(UNSETTLED.format(self.rule.estimator, PASSES))

    def update_linear(self, columns: Int, jacobian: Float, innovation: Float, noise_cov: Float) -> float:
        """Correct with innovations (r,) and their Jacobian (r, c) by the entries `columns` (c,); return the NIS.

        Raises:
            UserError: no update exists, because a number is not finite or `noise_cov` is not positive definite.
        """
        P, across = self.belief.cov[: self.size, : self.size], jacobian @ self.covariances(columns)
        S = across[:, columns] @ jacobian.T + noise_cov
        try:
            lower = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            lower = np.full_like(S, np.nan)
        if not ((np.diag(lower) ** 2 > LEAST_SHARE * np.diag(S)).all() and np.isfinite(innovation).all()):
            remedy = "make every value finite and every covariance positive definite"
            raise UserError(f"observation: no update exists; {remedy}; {why_not(math.nan, self.variances)}")
        W, y = solve_triangular(lower, across, lower=True), solve_triangular(lower, innovation, lower=True)
        P -= W.T @ W
        retract(self.belief, W.T @ y, self.form.invariant, self._workspace(1))
        return float(y @ y)

    def innovations(self, ids: Int, values: Float, covs: Float) -> tuple[Float, Float]:
        """Return innovations (m, d) of observations of the landmarks `ids` (m,), and their covariances (m, d, d)."""
        count, first = len(values), 2 - self.dim
        innovation, S = innovations_of(self.code, self.belief, self.slots_of(ids), *two_rows(values, covs))
        return innovation.reshape(count, 2)[:, first:], S[:, first:, first:]

    def without_outliers(self, ids: Int, values: Float, covs: Float, gate: float | None) -> Int:
        """Return a copy of the ids (m,), NONE for observations of mapped landmarks beyond the gate."""
        kept = ids.copy()
        if gate is not None:
            rows = np.flatnonzero(np.isin(ids, self.ids))
            v, S = self.innovations(ids[rows], values[rows], covs[rows])
            within = np.einsum("mi,mi->m", v, np.linalg.solve(S, v[:, :, None])[:, :, 0]) <= gate
            kept[rows[~within]] = NONE
        return kept

    def require_sound(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> None:
        """Refuse observations (m, d), (m, d, d) that `Recording` refuses."""
        if not are_sound(self.code, *two_rows(values, covs)):
            raise explain_scan(self.sensor, values, covs, math.nan, self.variances)

    def loaded(self, values: NDArray[np.generic], covs: NDArray[np.generic]) -> Workspace:
        """Return the workspace with observations (m, d), (m, d, d) in its first m rows."""
        work = self._workspace(len(values))
        fill_rows(values, covs, work.observation, work.observation_cov)
        return work

    def _workspace(self, observations: int) -> Workspace:
        """Return the workspace, with room for that many observations and for the state."""
        capacity = len(self.belief.state)
        if observations > len(self._work.ids) or capacity > self._work.W.shape[1]:
            self._work = allocate_workspace(max(observations, len(self._work.ids)), capacity, self.rule.block)
        return self._work

    def add(self, ids: Int, values: Float, covs: Float) -> None:
        """Map new landmarks (m,) at their first observations (m, 2), with covariances (m, 2, 2).

        For a bearing-only sensor the observations are ranges and bearings; the caller chooses the ranges.

        Raises:
            UserError: positions or covariances that are not finite; nothing has changed.
        """
        first, last = self.size, self.size + 2 * len(ids)
        self.reserve(last)
        augment(self.code, self.belief, *two_rows(values, covs))
        added = (self.belief.state[first:last], np.diagonal(self.belief.cov)[first:last])
        if not all(np.isfinite(each).all() for each in added):
            raise UserError(f"observation: the landmarks of this scan are not finite; {DIVERGED}")
        self.append(ids)

    def equate(self, one: int, other: int) -> None:
        """Correct with the noise-free observation that two landmarks are at the same place."""
        columns = self.columns_of(np.array([one, other]))
        first, second = self.entries(columns).reshape(2, 2)
        with suppress(UserError):  # they are equal already
            self.update_linear(columns, np.hstack([np.eye(2), -np.eye(2)]), second - first, np.zeros((2, 2)))


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
