"""Association of a scan with the landmarks of a map."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels import nearest_neighbour
from slamgauge.ekf.kernels.individual_compatibility import (
    Pairs,
    allocate_pairs,
    find_compatible,
    first_pairs,
)
from slamgauge.ekf.kernels.joint_compatibility import search_jointly
from slamgauge.ekf.kernels.linearisation import innovations_of
from slamgauge.ekf.maps.input_checks import explain_scan
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap, two_rows
from slamgauge.ekf.maps.transaction import is_addition_certain, transaction


class Matcher:
    """Compares observations (m, d), with covariances (m, d, d), with the landmarks of a map."""

    def __init__(self, landmarks: LandmarkMap) -> None:
        self._map = landmarks
        self._room = allocate_pairs(0)

    def compatible(self, values: Float, covs: Float, gate: float) -> tuple[Pairs, Float]:
        """Return the pairs of an observation and a landmark within `gate` (squared Mahalanobis).

        The pairs are valid until the next call. The second result is the covariances (m, 2, 2) as kernels read them,
        which `jointly_compatible` takes.
        """
        code, belief = self._map.correction.code, self._map.state.belief
        observation, noise_cov = two_rows(values, covs)
        count = find_compatible(code, belief, observation, noise_cov, gate, self._room)
        if count < 0:
            self._room = allocate_pairs(-2 * count)
            count = find_compatible(code, belief, observation, noise_cov, gate, self._room)
        return first_pairs(self._room, count), noise_cov

    def jointly_compatible(self, pairs: Pairs, covs: Float, gate: float, quantiles: Float, node_limit: int) -> Int:
        """Return the slots (m,) of the best joint association, -1 for none.

        See `kernels.joint_compatibility.search_jointly`.
        """
        return search_jointly(self._cov, covs, pairs, gate, quantiles, node_limit)[0]

    @property
    def _cov(self) -> Float:
        return self._map.state.belief.cov


def update_nearest(
    landmarks: LandmarkMap, ids: Ids, values: Float, covs: Float, gates: nearest_neighbour.Gates
) -> tuple[Int, float, int]:
    """Associate each observation with its nearest landmark, then correct or map; see `kernels.nearest_neighbour`.

    New landmarks get their ids from `ids`.

    Returns:
        Slots (m,), -1 for none; the NIS and its degrees of freedom.

    Raises:
        UserError: no update exists.
    """
    state, correction = landmarks.state, landmarks.correction
    count, before = len(values), state.size
    state.reserve(before + 2 * count)
    work = correction.loaded(values, covs)
    is_one_block = count <= correction.rule.block  # P changes at the end only
    certain = is_one_block and is_addition_certain(landmarks)
    with transaction(landmarks, covariance=not certain):
        update = nearest_neighbour.update_nearest(correction.code, state.belief, count, gates, correction.form, work)
        variances = np.diagonal(state.belief.cov)[: update.size]
        if not (np.isfinite(update.nis) and np.isfinite(variances).all()):
            raise explain_scan(correction.sensor, values, covs, update.nis, variances)
    added = (update.size - before) // 2
    state.resize(update.size)
    if added:
        state.set_ids(np.concatenate([state.ids, ids.take(added)]))
    return update.slots.copy(), update.nis, update.dof


def innovations(landmarks: LandmarkMap, slots: Int, values: Float, covs: Float) -> tuple[Float, Float]:
    """Return innovations (m, d) of observations of the landmarks in `slots` (m,), and their covariances (m, d, d)."""
    count, first = len(slots), 2 - values.shape[1]
    belief = landmarks.state.belief
    innovation, S = innovations_of(landmarks.correction.code, belief, slots, *two_rows(values, covs))
    return innovation.reshape(count, 2)[:, first:], S[:, first:, first:]


def are_within(landmarks: LandmarkMap, slots: Int, values: Float, covs: Float, gate: float) -> Marks:
    """Return which observations (m, d) of landmarks in `slots` (m,) have a squared distance up to `gate`."""
    v, S = innovations(landmarks, slots, values, covs)
    return np.einsum("mi,mi->m", v, np.linalg.solve(S, v[:, :, None])[:, :, 0]) <= gate
