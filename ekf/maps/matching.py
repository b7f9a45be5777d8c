"""Which landmarks of a map the observations of a scan may be of."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels.individual_compatibility import (
    Pairs,
    allocate_pairs,
    find_compatible,
    find_located,
    keep_pairs,
)
from slamgauge.ekf.kernels.joint_compatibility import mark_ambiguous, search_jointly
from slamgauge.ekf.kernels.linearisation import describe
from slamgauge.ekf.kernels.sequential_association import Gates, update_one_by_one
from slamgauge.ekf.kernels.warm_up import compile_association_once
from slamgauge.ekf.maps.correction_table import sequential_of
from slamgauge.ekf.maps.input_checks import explain_scan
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.transaction import is_addition_certain, undone_if_refused


class Matcher:
    """Compares observations (m, d), with covariances (m, d, d), with the landmarks of a map."""

    def __init__(self, landmarks: LandmarkMap) -> None:
        compile_association_once()
        self._map = landmarks
        self._pairs = allocate_pairs(0)
        self._covs: Float = np.zeros((0, 2, 2))  # of the scan that `compatible` was given

    def compatible(self, values: Float, covs: Float, gate: float) -> tuple[Pairs, int]:
        """Pairs of an observation and a landmark within `gate` (squared Mahalanobis), and their number.

        They are valid until the next call.
        """
        given, work = len(values), self._map.room_for(len(values))
        self._map.load(values, covs)
        scan = (work.observation[:given], work.observation_cov[:given])
        self._covs = scan[1]
        count = find_compatible(self._map.code, self._map.belief, *scan, gate, self._pairs)
        if count < 0:
            self._pairs = allocate_pairs(-2 * count)
            count = find_compatible(self._map.code, self._map.belief, *scan, gate, self._pairs)
        return self._pairs, count

    def located(self, count: int, vagueness: float, recent: Marks) -> int:
        """Keep those of the first `count` pairs of `compatible` whose landmarks the robot knows the place of.

        See `kernels.individual_compatibility.find_located`. Returns how many these are.
        """
        cov = self._map.belief.cov
        return keep_pairs(self._pairs, find_located(cov, self._covs, self._pairs, count, vagueness, recent))

    def jointly_compatible(self, count: int, gate: float, quantiles: Float, node_limit: int) -> Int:
        """Slots (m,) of the best joint association of the first `count` pairs of `compatible`, -1 for none.

        Args:
            count: how many pairs.
            gate: see `kernels.joint_compatibility.search_jointly`, also for the others.
            quantiles: (m + 1,).
            node_limit: pairs to try.
        """
        best = np.empty(len(self._covs), dtype=np.int64)
        search_jointly(self._map.belief.cov, self._covs, self._pairs, count, gate, quantiles, node_limit, best)
        return best

    def ambiguous(self, count: int, gate: float, margin: float, node_limit: int, slots: Int) -> Marks:
        """Which observations (m,) of `compatible` another association than `slots` (m,) explains nearly as well.

        See `kernels.joint_compatibility.mark_ambiguous`.
        """
        marks = np.zeros(len(slots), dtype=np.bool_)
        mark_ambiguous(self._map.belief.cov, self._covs, self._pairs, count, gate, margin, node_limit, slots, marks)
        return marks


def update_nearest(
    landmarks: LandmarkMap, ids: Ids, values: Float, covs: Float, gates: Gates
) -> tuple[Int, float, int]:
    """Associate each observation with its nearest landmark, then correct or map; see `kernels.sequential_association`.

    New landmarks get their ids from `ids`.

    Returns:
        Slots (m,), -1 for none; the NIS and its degrees of freedom.

    Raises:
        UserError: the rule has no such form, or there is no update.
    """
    form, count = sequential_of(landmarks.rule), len(values)
    landmarks.reserve(landmarks.unsettled.size + 2 * count)
    work = landmarks.room_for(count)
    landmarks.load(values, covs)
    is_one_block = count <= landmarks.rule.block  # of which P is settled at the end
    certain = is_one_block and is_addition_certain(landmarks)
    with undone_if_refused(landmarks, covariance=not certain):
        nis, informative, size = update_one_by_one(landmarks.code, landmarks.belief, count, gates, form, work)
        variances = np.diagonal(landmarks.belief.cov)[:size]
        if not (np.isfinite(nis) and np.isfinite(variances).all()):
            raise explain_scan(landmarks.sensor, values, covs, nis, variances)
    added = (size - landmarks.unsettled.size) // 2
    landmarks.resize(size)
    if added:
        landmarks.name(np.concatenate([landmarks.ids, ids.take(added)]))
    return work.slots[:count].copy(), nis, informative


def innovations(landmarks: LandmarkMap, slots: Int, values: Float, covs: Float) -> tuple[Float, Float]:
    """Innovations (m, d) of observations of the landmarks in `slots` (m,), and each one's covariance (m, d, d)."""
    count, first = len(slots), 2 - values.shape[1]
    work = landmarks.room_for(count)
    work.slots[:count] = slots
    landmarks.load(values, covs)
    S = np.empty((count, 2, 2))
    describe(landmarks.code, landmarks.unsettled, count, work, S)
    return work.innovation[: 2 * count].reshape(count, 2)[:, first:].copy(), S[:, first:, first:]


def are_within(landmarks: LandmarkMap, slots: Int, values: Float, covs: Float, gate: float) -> Marks:
    """Which observations (m, d) of the landmarks in `slots` (m,) have a squared Mahalanobis distance up to `gate`."""
    v, S = innovations(landmarks, slots, values, covs)
    return np.einsum("mi,mi->m", v, np.linalg.solve(S, v[:, :, None])[:, :, 0]) <= gate
