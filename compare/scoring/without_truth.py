"""Consistency of a filter without ground truth (Hausman, Econometrica 46(6), 1978); docs/no_ground_truth.md derives it.

Let d be the difference of a filter's pose (covariance P_f) and that of the optimum of all measurements (P_s). The
statistic of a step is the expected NEES given d, which is 3 on average if the filter is consistent:

    c = d' P_f^-1 d + tr(P_f^-1 P_s)

Its mean, and the mean squared residuals of odometry and observations at the optimum, which show wrong noise, are
compared with those of simulated twins of the same log. The largest of the three standardised logarithms is ranked
(Westfall and Young, Resampling-Based Multiple Testing, 1993): the level is exact if log and twins are exchangeable.
They differ in the path, which is the optimum's, and in the filter, which is not the tested one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from tqdm import tqdm

from slamgauge.arrays import Float, Marks
from slamgauge.compare.estimators.registry import CAUSAL
from slamgauge.compare.estimators.stored_trajectory import OwnPoses
from slamgauge.compare.scoring.consistency import pose_errors, squared_mahalanobis
from slamgauge.compare.scoring.intervals import defined_mean, number
from slamgauge.compare.scoring.own_stamps import optimum_at
from slamgauge.compare.scoring.run_arrays import pose_covs_of
from slamgauge.covariances import square_roots
from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording
from slamgauge.se2 import between, in_body
from slamgauge.sensors import SENSORS, innovation, predict

TEST_LEVEL = 0.05  # probability that a consistent filter is rejected
BAND = 0.95  # share of the twins within a band over time
FEWEST = 19  # twins: with fewer, no p-value is at most TEST_LEVEL
NEAREST = 1e-3  # m: least range that a twin observes
DIVERGED = 1e100  # figures of diverged filters are cut here, so that their logarithms are finite
INTERVALS = 100  # largest number of intervals of time in figures over time
RESIDUALS = {1: ("odometry", "Q", ""), 2: ("observation", "R", " or observations are outliers")}


class Figures(NamedTuple):
    """Figures of a filter on a log; those of T twins have a leading axis T."""

    means: Float  # (3,) ratio of the filter, then mean squared residuals of odometry and observations at the optimum
    course: Float  # (B,) expected NEES over 3 in intervals of time; NaN without an invertible covariance


@dataclass(frozen=True)
class ConsistencyTest:
    """Test of one filter: its figures on the log, and those of a consistent filter on T twins."""

    log: Figures
    twins: Figures

    @cached_property
    def deviations(self) -> Float:
        """(1+T, 3) standardised logarithms of the figures, the log first; 0 for a figure that is 0 or undefined."""
        with np.errstate(divide="ignore", invalid="ignore"):
            every = np.log(np.vstack([self.log.means.clip(max=DIVERGED), self.twins.means]))
            found = (every - every.mean(axis=0)) / every.std(axis=0)
        return np.where(np.isfinite(found), found, 0.0)

    @cached_property
    def p_values(self) -> Float:
        """(3,) probability that a consistent filter has any figure that deviates as much as this one."""
        largest = np.abs(self.deviations[1:]).max(axis=1)
        return (1 + np.sum(largest[:, None] >= np.abs(self.deviations[0]), axis=0)) / (1 + len(largest))

    @property
    def verdict(self) -> Literal["consistent", "overconfident", "too cautious"]:
        """Direction of the first figure that is rejected."""
        rejected = np.flatnonzero(self.p_values <= TEST_LEVEL)
        if not len(rejected):
            return "consistent"
        return "overconfident" if self.deviations[0, rejected[0]] > 0.0 else "too cautious"

    def to_json(self, stamps: Float) -> dict[str, Any]:
        """Return the entry in metrics.json; `stamps` (N+1,) are those of the recording [s]."""
        low, high = np.quantile(self.twins.course, [(1 - BAND) / 2, (1 + BAND) / 2], axis=0)
        return {
            "verdict": self.verdict,
            "p_value": float(self.p_values.min()),
            "p_values": dict(zip(("difference", "odometry", "observations"), self.p_values.tolist(), strict=True)),
            "ratio": number(self.log.means[0]),
            "time_s": [float(each.mean()) for each in np.array_split(stamps, len(low))],
            "expected_nees_per_dof": [*map(number, self.log.course)],
            "twins_low": [*map(number, low)],
            "twins_high": [*map(number, high)],
        }

    def text(self) -> str:
        """Return the verdict without a full stop."""
        if np.isnan(self.log.means[0]):
            return "without ground truth: not tested, because no step has an invertible covariance"
        size = f"errors are about {np.sqrt(self.log.means[0]):.2f} times its sigmas"
        if self.verdict == "consistent":
            return f"without ground truth: consistent as far as this log shows, {size} (p = {self.p_values.min():.2g})"
        found = [f"{size} (p = {self.p_values[0]:.2g})"] if self.p_values[0] <= TEST_LEVEL else []
        which = 1 + int(np.argmax(np.abs(self.deviations[0, 1:])))
        if self.p_values[which] <= TEST_LEVEL:
            name, noise, other = RESIDUALS[which]
            times = np.sqrt(self.log.means[which] / np.mean(self.twins.means[:, which]))
            cause = f"{noise} is too small{other}" if self.deviations[0, which] > 0.0 else f"{noise} is too large"
            p = self.p_values[which]
            found.append(f"{name} residuals are {times:.2f} times those of twins (p = {p:.2g}): {cause}")
        return f"without ground truth: {self.verdict}, {'; '.join(found)}"


def tested_filters(
    recording: Recording,
    estimates: Mapping[str, Estimate],
    optimum: Estimate,
    twins: int,
    own: Mapping[str, OwnPoses | None],
) -> dict[str, ConsistencyTest]:
    """Test all filtered estimates with covariances, by name, with the optimum of all measurements and its associations.

    Stored trajectories with poses at their `own` stamps, and their twins, are compared at the same steps.
    """
    if twins < FEWEST:
        raise UserError(f"twins: {twins} are too few for a test of level {TEST_LEVEL:.0%}; give {FEWEST} or more")
    log = recording if optimum.association is None else recording.associated(optimum.association)
    filters: dict[str, tuple[Estimator, Marks | None]] = {}
    found: dict[str, Figures] = {}
    for name, estimate in estimates.items():
        if estimate.kind == "filtered" and estimate.pose_covs is not None:
            compared, best, stored = None, optimum, own.get(name)
            if stored is not None:
                estimate, compared, best = stored.estimate, stored.compared, optimum_at(stored.stamps, optimum, log)
            found[name] = figures(log, optimum, expected_nees(estimate, best, compared))
            filters[name] = consistent_filter(name, log), compared
    drawn = tqdm(simulated_twins(log, optimum, twins), "twins", twins, delay=2.0, disable=None, leave=False)
    of_twins = figures_of(filters, drawn) if filters else {}
    return {name: ConsistencyTest(found[name], each) for name, each in of_twins.items()}


def figures(recording: Recording, optimum: Estimate, expected: Float) -> Figures:
    """Return the figures of a filter on a recording with ids, from its `expected_nees`.

    Observations of landmarks that the optimum lacks are left out.
    """
    moving = pose_errors(between(optimum.poses[:-1], optimum.poses[1:]), recording.odometry)
    log, seen = _observed(recording, optimum)
    seeing = innovation(log.sensor, log.observation, seen)
    residuals = [_mean_square(moving, recording.odometry_cov), _mean_square(seeing, log.observation_cov)]
    course = [defined_mean(each) / 3.0 for each in np.array_split(expected, min(INTERVALS, len(expected)))]
    return Figures(np.array([defined_mean(expected) / 3.0, *residuals]), np.array(course))


def expected_nees(estimate: Estimate, optimum: Estimate, compared: Marks | None = None) -> Float:
    """Return the expected NEES c (N+1,) of a filter.

    It is NaN where the filter's covariance is singular, and at steps that are not `compared` (N+1,); None: all are.
    """
    covs = pose_covs_of(estimate)
    squares = squared_mahalanobis(pose_errors(optimum.poses, estimate.poses), covs)
    rows = np.flatnonzero(~np.isnan(squares) & (True if compared is None else compared))
    expected = np.full(len(squares), np.nan)
    shares = np.linalg.solve(covs[rows], pose_covs_of(optimum)[rows])
    expected[rows] = squares[rows] + np.trace(shares, axis1=1, axis2=2)
    return expected


def consistent_filter(name: str, recording: Recording) -> Estimator:
    """Return the filter that runs on twins: `riekf`, but `causal` if bearing-only, and for `causal` itself."""
    return riekf if name != CAUSAL and SENSORS[recording.sensor].places_landmarks else causal


def figures_of(
    filters: Mapping[str, tuple[Estimator, Marks | None]], recordings: Iterable[Recording]
) -> dict[str, Figures]:
    """Return the figures of filters on recordings, by name, each with the steps (N+1,) that are compared, or None."""
    rows: dict[str, list[Figures]] = {name: [] for name in filters}
    for each in recordings:
        optimum = batch(each)
        ran = {filter_: filter_(each) for filter_ in {filter_ for filter_, _ in filters.values()}}
        for name, (filter_, compared) in filters.items():
            rows[name].append(figures(each, optimum, expected_nees(ran[filter_], optimum, compared)))
    return {name: Figures(*map(np.array, zip(*found, strict=True))) for name, found in rows.items()}


def simulated_twins(recording: Recording, optimum: Estimate, count: int, seed: int = 0) -> Iterator[Recording]:
    """Draw new measurements of a recording with ids whose optimum is the truth, `count` times.

    Steps, landmarks and covariances are the same. Observations of landmarks that the optimum lacks are left out.
    """
    log, seen = _observed(recording, optimum)
    moved = between(optimum.poses[:-1], optimum.poses[1:])
    for stream in np.random.SeedSequence(seed).spawn(count):
        rng = np.random.default_rng(stream)
        observation = innovation(log.sensor, seen + _noise(rng, log.observation_cov), np.zeros_like(seen))
        if SENSORS[log.sensor].has_range:
            observation[:, 0] = observation[:, 0].clip(min=NEAREST)
        yield replace(
            log,
            prior_mean=optimum.poses[0] + _noise(rng, log.prior_cov[None])[0],
            odometry=moved + _noise(rng, log.odometry_cov),
            observation=observation,
        )


def _observed(recording: Recording, optimum: Estimate) -> tuple[Recording, Float]:
    """Return the observations of landmarks of the optimum, and their values (M, d) at the optimum."""
    assert recording.landmark is not None
    log = recording.only(np.isin(recording.landmark, optimum.landmark_ids))
    assert log.landmark is not None
    order = np.argsort(optimum.landmark_ids)
    landmarks = optimum.landmarks[order][np.searchsorted(optimum.landmark_ids[order], log.landmark)]
    return log, predict(log.sensor, in_body(optimum.poses[log.observation_step], landmarks))


def _mean_square(residuals: Float, covs: Float) -> float:
    """Return the mean of r' cov^+ r over residuals (n, d); 0 without a residual."""
    weights = np.linalg.pinv(covs, hermitian=True)
    return float(np.einsum("ni,nij,nj->", residuals, weights, residuals)) / max(len(residuals), 1)


def _noise(rng: np.random.Generator, covs: Float) -> Float:
    """Draw errors (n, d) with covariances (n, d, d)."""
    return np.einsum("nij,nj->ni", square_roots(covs), rng.standard_normal(covs.shape[:2]))
