"""Consistency of a filter without ground truth (Hausman, Econometrica 46(6), 1978).

Let x_f be the pose of a filter at a step and x_s that of the optimum of all measurements, with errors e_f and e_s,
covariances P_f and P_s, and the difference d = x_f - x_s = e_f - e_s. If the noise of the recording is right, the
optimum is efficient: no unbiased combination x_s + A d has a smaller covariance, so that cov(e_s, d) = 0. Then

    P_f = cov(e_s + d) = P_s + cov(d),    cov(d) = P_f - P_s.

This holds for every unbiased filter that states its own covariance, also for one that does not use all of its
measurements. For the Kalman filter and the smoother of Rauch, Tung and Striebel (1965) it is an identity. Two
statistics of a step follow:

    expected NEES   c = d' P_f^-1 d + tr(P_f^-1 P_s)    the mean of e_f' P_f^-1 e_f given d; if consistent 3 on average
    Hausman         h = d' (P_f - P_s)^+ d              on the subspace where P_f - P_s > 0; its mean is the dimension

Where P_f - P_s has a negative eigenvalue, the filter claims to be more certain than the optimum. The Hausman statistic
omits this direction; the expected NEES does not, so that the test uses the expected NEES.

Errors at neighbouring steps are correlated. The mean over time is therefore compared with that of simulated twins of
the same log: its optimum is the true path and map, new noise is drawn from the stated covariances, and a consistent
filter and the optimum are computed. The p-value is exact up to the difference between the filters' correlations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.scoring.trajectory_error import pose_errors
from slamgauge.covariances import square_roots
from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import between, rotation, wrap
from slamgauge.sensors import SENSORS, predict

LEVEL = 0.05  # of the test
SMALL = 0.01  # share of P_f: smaller eigenvalues of P_f - P_s count as 0
NEAREST = 1e-3  # m: least range that a twin observes


class StepStatistics(NamedTuple):
    """Statistics of each step; NaN, 0 and False where the filter's covariance is singular.

    Attributes:
        expected_nees: (N+1,) c; 3 on average if the filter is consistent.
        hausman: (N+1,) h.
        dof: (N+1,) dimension of the subspace of h.
        claims_more: (N+1,) whether the filter claims more than the optimum in some direction.
    """

    expected_nees: Float
    hausman: Float
    dof: Int
    claims_more: Marks

    @property
    def ratio(self) -> float:
        """Mean of the expected NEES over time, divided by 3; NaN without a step."""
        known = self.expected_nees[~np.isnan(self.expected_nees)]
        return float(np.mean(known)) / 3.0 if len(known) else np.nan


@dataclass(frozen=True)
class ConsistencyTest:
    """Result of the test of one filter.

    Attributes:
        ratio: mean of the expected NEES over 3: squared ratio of the errors to the filter's sigmas.
        twins: (T,) the same figure of a consistent filter on each twin.
        claims_more: share of the steps at which the filter claims more than the optimum.
    """

    ratio: float
    twins: Float
    claims_more: float

    @property
    def p_value(self) -> float:
        """Probability that a consistent filter has at least this ratio."""
        return (1 + int(np.sum(self.twins >= self.ratio))) / (1 + len(self.twins))

    @property
    def p_cautious(self) -> float:
        """Probability that a consistent filter has at most this ratio."""
        return (1 + int(np.sum(self.twins <= self.ratio))) / (1 + len(self.twins))

    def text(self) -> str:
        """Return the verdict without a full stop."""
        factor = np.sqrt(self.ratio)
        more = f"; it claims more than the optimum at {self.claims_more:.0%} of the steps" if self.claims_more else ""
        size = f"errors are about {factor:.2f} times its sigmas"
        if self.p_value <= LEVEL:
            return f"without ground truth: overconfident, {size} (p = {self.p_value:.2g}){more}"
        if self.p_cautious <= LEVEL:
            return f"without ground truth: too cautious, {size} (p = {self.p_cautious:.2g})"
        return f"without ground truth: consistent as far as this log shows, {size} (p = {self.p_value:.2g})"


def step_statistics(estimate: Estimate, optimum: Estimate) -> StepStatistics:
    """Compare a filter with the optimum of all measurements.

    Raises:
        UserError: one of them has no covariances.
    """
    if estimate.pose_covs is None or optimum.pose_covs is None:
        raise UserError("pose_covs: the test without ground truth needs covariances of the poses; add them")
    count = len(estimate.poses)
    expected, hausman = np.full(count, np.nan), np.full(count, np.nan)
    dof, claims_more = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=bool)
    variances = np.diagonal(estimate.pose_covs, axis1=1, axis2=2)
    rows = np.flatnonzero((variances > 0.0).all(axis=1))
    scale = np.sqrt(variances[rows])
    claimed = estimate.pose_covs[rows] / (scale[:, :, None] * scale[:, None, :])
    definite = np.linalg.eigvalsh(claimed)[:, 0] > 1e-9
    rows, scale, claimed = rows[definite], scale[definite], claimed[definite]
    white = np.linalg.inv(np.linalg.cholesky(claimed)) / scale[:, None, :]  # white P_f white' = I
    d = np.einsum("nij,nj->ni", white, pose_errors(optimum.poses[rows], estimate.poses[rows]))
    optimal = white @ optimum.pose_covs[rows] @ white.swapaxes(1, 2)
    expected[rows] = np.sum(d**2, axis=1) + np.trace(optimal, axis1=1, axis2=2)
    gap, axes = np.linalg.eigh(np.eye(3) - optimal)
    along, used = np.einsum("nji,nj->ni", axes, d), gap > SMALL
    hausman[rows] = np.sum(np.where(used, along**2 / np.where(used, gap, 1.0), 0.0), axis=1)
    dof[rows], claims_more[rows] = used.sum(axis=1), (gap < -SMALL).any(axis=1)
    return StepStatistics(expected, hausman, dof, claims_more)


def consistency_test(statistics: StepStatistics, twins: Float) -> ConsistencyTest:
    """Return the test of a filter from its steps and the ratios (T,) of twins."""
    return ConsistencyTest(statistics.ratio, twins, float(np.mean(statistics.claims_more)))


def tested_filters(
    recording: Recording, estimates: Mapping[str, Estimate], optimum: Estimate, twins: int
) -> dict[str, ConsistencyTest]:
    """Test all filtered estimates with covariances, by name.

    Args:
        recording: measurements.
        estimates: by name; smoothed ones are left out.
        optimum: the optimum of all measurements, with the associations that it used.
        twins: number of simulated twins.
    """
    log = recording if optimum.association is None else recording.associated(optimum.association)
    filters = {name: each for name, each in estimates.items() if each.kind == "filtered" and each.pose_covs is not None}
    ratios = twin_ratios(log, optimum, twins) if filters else np.zeros(0)
    return {name: consistency_test(step_statistics(each, optimum), ratios) for name, each in filters.items()}


def twin_ratios(recording: Recording, optimum: Estimate, twins: int, seed: int = 0) -> Float:
    """Return the ratio (T,) of a consistent filter on simulated twins of a recording.

    The filter is `riekf`, or `causal` if the recording is bearing-only.

    Args:
        recording: measurements with ids.
        optimum: the optimum of all of them.
        twins: number of twins.
        seed: root seed.
    """
    consistent: Callable[[Recording], Estimate] = riekf if SENSORS[recording.sensor].places_landmarks else causal
    found = np.empty(twins)
    streams = np.random.SeedSequence(seed).spawn(twins)
    for at, stream in enumerate(tqdm(streams, desc="twins", delay=2.0, disable=None, leave=False)):
        twin = simulated_twin(recording, optimum, np.random.default_rng(stream))
        found[at] = step_statistics(consistent(twin), batch(twin)).ratio
    return found


def simulated_twin(recording: Recording, optimum: Estimate, rng: np.random.Generator) -> Recording:
    """Draw new measurements of a recording whose optimum is the truth; steps, landmarks and covariances are the same.

    Observations of landmarks that the optimum does not have are left out.
    """
    assert recording.landmark is not None
    log = recording.only(np.isin(recording.landmark, optimum.landmark_ids))
    assert log.landmark is not None
    order = np.argsort(optimum.landmark_ids)
    landmarks = optimum.landmarks[order][np.searchsorted(optimum.landmark_ids[order], log.landmark)]
    poses = optimum.poses[log.observation_step]
    delta = np.einsum("nji,nj->ni", rotation(poses[:, 2]), landmarks - poses[:, :2])
    observation = predict(log.sensor, delta) + _noise(rng, log.observation_cov)
    observation = np.where(SENSORS[log.sensor].is_angle, wrap(observation), observation)
    if SENSORS[log.sensor].has_range:
        observation[:, 0] = observation[:, 0].clip(min=NEAREST)
    return replace(
        log,
        prior_mean=optimum.poses[0] + _noise(rng, log.prior_cov[None])[0],
        odometry=between(optimum.poses[:-1], optimum.poses[1:]) + _noise(rng, log.odometry_cov),
        observation=observation,
    )


def _noise(rng: np.random.Generator, covs: Float) -> Float:
    """Draw errors (n, d) with covariances (n, d, d)."""
    return np.einsum("nij,nj->ni", square_roots(covs), rng.standard_normal(covs.shape[:2]))
