"""Every filter against its textbook twin and, where those two differ, against extended precision.

Differences are in sigmas of the referee: the largest of |d_i| / sigma_i and of |s_i - sigma_i| / sigma_i, over poses
and their components. A sigma is taken for at least what makes the bar `SPACINGS` spacings of doubles at the place:
`1e-6` of a sigma of .01 mm cannot be had from a coordinate of 100 km.

Both twins start at the origin, which changes nothing but their rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from references.extended import DIGITS_GAINED, Long, Path, as_long, extended, long_rotation, long_wrap, solved
from references.verdicts import FILTER_BAR, Outcome, attempt
from slamgauge.arrays import Float, Int
from slamgauge.ekf import SlamFilter, ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook_ekf
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import wrap
from tests.reference.textbook import textbook_fej_ekf, textbook_iekf, textbook_oc_ekf, textbook_riekf

SPACINGS = 16
ROUNDINGS = 8  # of a covariance, to see what they change
ANOTHER_MINIMUM = 1e-3  # sigma; what differs by less has come to the same one, and not near enough

Filter = Callable[[Recording], Estimate]


class Pair(NamedTuple):
    """A filter of ours and its twin."""

    ours: Filter
    twin: Filter


PAIRS = {
    "ekf": Pair(ekf_slam, textbook_ekf),
    "fej-ekf": Pair(fej_ekf, textbook_fej_ekf),
    "oc-ekf": Pair(oc_ekf, textbook_oc_ekf),
    "iekf": Pair(iekf, textbook_iekf),
    "riekf": Pair(riekf, textbook_riekf),
}


def judge_filters(recording: Recording) -> list[Outcome]:
    """An outcome for each of `PAIRS`, and `iekf minimum`: whether iekf ends where its own cost has a minimum."""
    if recording.sensor == "bearing":
        return [_of_bearings(recording, name) for name in PAIRS]
    minimum = judge_minimum(recording)
    outcomes = [judge_filter(recording, name) for name in PAIRS]
    return [*(_unless_a_minimum(each, minimum) for each in outcomes), minimum]


def _unless_a_minimum(outcome: Outcome, minimum: Outcome) -> Outcome:
    """Where iekf ends in minima of its own cost, though not in the referee's, nobody is wrong."""
    if outcome.estimator != "iekf" or outcome.verdict != "worse" or minimum.verdict != "agrees":
        return outcome
    if outcome.difference < ANOTHER_MINIMUM:
        return outcome
    return replace(outcome, verdict="undecided", note=f"other minima than the referee's; {outcome.note}")


def _of_bearings(recording: Recording, name: str) -> Outcome:
    """Rays have no twin; the filter must run."""
    estimate = attempt(PAIRS[name].ours, recording)
    if isinstance(estimate, str):
        return Outcome(name, "failed", math.inf, estimate)
    return Outcome(name, "not compared")


def judge_filter(recording: Recording, name: str) -> Outcome:
    """The filter of that name on a recording with ranges and ids.

    One that refuses where its textbook form is wrong, too, says rightly that double precision is exhausted. Where the
    textbook form does not keep its digits it is no referee: there a filter has to be no further off than that, and
    where extended precision may have lost them as well, nothing can be said.
    """
    estimate = attempt(PAIRS[name].ours, recording)
    twin = _twin(recording, name)
    to_twin = math.inf if twin is None or isinstance(estimate, str) else _apart(estimate, twin, recording)
    if to_twin <= FILTER_BAR:
        return Outcome(name, "agrees", to_twin)
    referee = extended(recording, name)
    if not (np.isfinite(referee.poses).all() and np.isfinite(referee.sigmas).all()):
        return Outcome(name, "undecided", to_twin, "not even extended precision has an answer")
    lost = math.inf if twin is None else difference(twin, referee, recording)
    if isinstance(estimate, str):
        exhausted = twin is not None and lost > FILTER_BAR  # a twin without an answer proves nothing
        return Outcome(name, "undecided" if exhausted else "failed", math.inf, estimate)
    found = _apart(estimate, referee, recording)
    if found <= FILTER_BAR:
        return Outcome(name, "agrees", found, "the textbook form loses digits")
    same_minimum = name != "iekf" or found < ANOTHER_MINIMUM
    keeps_digits = lost <= (FILTER_BAR if found <= lost else FILTER_BAR * DIGITS_GAINED)
    if same_minimum and not keeps_digits:
        return Outcome(name, "undecided", found, f"the textbook form is {lost:.1e} sigma from extended precision")
    return Outcome(name, "worse", min(found, to_twin), f"textbook {to_twin:.1e}, extended {found:.1e}")


def _apart(estimate: Estimate, referee: Path, recording: Recording) -> float:
    return difference(_path(estimate, recording), referee, recording)


def _twin(recording: Recording, name: str) -> Path | None:
    """The textbook filter from the origin; None where it has no answer."""
    mean = np.array([0.0, 0.0, recording.prior_mean[2]])
    moved = replace(recording, prior_mean=mean)
    with np.errstate(all="ignore"):
        estimate = attempt(PAIRS[name].twin, moved)
    return None if isinstance(estimate, str) else _path(estimate, moved)


def _path(estimate: Estimate, recording: Recording) -> Path:
    assert estimate.pose_covs is not None
    poses = estimate.poses.copy()
    poses[:, :2] -= recording.prior_mean[:2]
    variances = np.diagonal(estimate.pose_covs, axis1=1, axis2=2)
    return Path(poses, np.sqrt(np.maximum(variances, 0.0)))


def difference(ours: Path, referee: Path, recording: Recording) -> float:
    """In sigmas of the referee; infinite if anything is not finite."""
    farthest = np.abs(referee.poses[:, :2]).max(axis=1) + np.abs(recording.prior_mean[:2]).max()
    magnitude = np.column_stack([farthest, farthest, np.full(len(farthest), np.pi)])
    sigma = np.maximum(referee.sigmas, SPACINGS / FILTER_BAR * np.spacing(magnitude))
    apart = ours.poses - referee.poses
    apart[:, 2] = wrap(apart[:, 2])
    apart, wider = np.abs(apart) / sigma, np.abs(ours.sigmas - referee.sigmas) / sigma
    largest = float(np.maximum(apart, wider).max())
    return largest if math.isfinite(largest) else math.inf


# --- the minimum of the iterated filter ------------------------------------------------------------


def judge_minimum(recording: Recording, correction: Correction = "iterated") -> Outcome:
    """How far, in sigmas, another pass of iekf would lead after each of its updates: the gradient of its own cost.

    Undecided where a spacing of doubles more or less in the covariance before the update changes that by the bar.
    """
    name = "iekf minimum"
    slam = SlamFilter(recording.sensor, recording.prior_mean, recording.prior_cov, correction)
    worst, lost, at = 0.0, False, 0
    try:
        for k, scan in enumerate(recording.scans()):
            if k > 0:
                slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
            assert scan.landmark is not None
            mapped = np.isin(scan.landmark, slam.landmark_ids)
            old, new = (Observations(scan.landmark[r], scan.value[r], scan.cov[r]) for r in (mapped, ~mapped))
            if mapped.any():
                worst, lost, at = max((worst, lost, at), (*_next_pass(slam, old, recording.sensor), k))
            if not mapped.all():
                slam.update(new)
    except UserError as error:
        return Outcome(name, "failed", math.inf, str(error))
    verdict = "agrees" if worst <= FILTER_BAR else "undecided" if lost else "worse"
    return Outcome(name, verdict, worst, f"step {at}")


def _next_pass(slam: SlamFilter, scan: Observations, sensor: str) -> tuple[float, bool]:
    """Update with a scan of mapped landmarks; the largest component of the pass that would follow, in sigmas.

    In extended precision, and whether rounding of the covariance before the update changes it by the bar.
    """
    before, P = as_long(_state(slam)), as_long(slam.cov)
    slam.update(scan)
    after = as_long(_state(slam))
    assert scan.landmark is not None
    order = slam.landmark_ids.tolist()
    slots = np.array([order.index(name) for name in scan.landmark.tolist()])
    v, H = _linearised(sensor, after, slots, as_long(scan.value))
    moved = after - before
    moved[2] = long_wrap(moved[2])
    R = as_long(np.zeros((len(v), len(v))))
    for a, block in enumerate(scan.cov):
        R[2 * a : 2 * a + 2, 2 * a : 2 * a + 2] = block

    def step(P: Long) -> Long:
        return P @ H.T @ solved(H @ P @ H.T + R, v + H @ moved) - moved

    sigma = np.sqrt(np.maximum(np.diag(slam.cov), 0.0))
    sigma = np.maximum(sigma, SPACINGS / FILTER_BAR * np.spacing(np.abs(_state(slam)).max()))

    def size(step: Long) -> float:
        return float((np.abs(step.astype(np.float64)) / sigma).max())

    left = size(step(P))
    lost = left > FILTER_BAR and any(size(step(rounded) - step(P)) > FILTER_BAR for rounded in _roundings(P))
    return left, lost


def _roundings(P: Long) -> Iterator[Long]:
    """Symmetric matrices (n, n) whose entries are a spacing of doubles from those of P, up or down."""
    rng, spacing = np.random.default_rng(len(P)), np.spacing(np.abs(P.astype(np.float64)))
    for _ in range(ROUNDINGS):
        rounding = spacing * rng.choice([-1.0, 1.0], P.shape)
        yield P + np.triu(rounding) + np.triu(rounding, 1).T


def _state(slam: SlamFilter) -> Float:
    """(3 + 2L,)."""
    return np.concatenate([slam.pose, slam.landmarks.ravel()])


def _linearised(sensor: str, x: Long, slots: Int, values: Long) -> tuple[Long, Long]:
    """Innovations (2m,) and their Jacobian (2m, n) at x."""
    v, H = as_long(np.zeros(2 * len(slots))), as_long(np.zeros((2 * len(slots), len(x))))
    to_body = long_rotation(x[2]).T
    for a, slot in enumerate(slots.tolist()):
        columns, rows = slice(3 + 2 * slot, 5 + 2 * slot), slice(2 * a, 2 * a + 2)
        offset = x[columns] - x[:2]
        delta, A = to_body @ offset, as_long(np.eye(2))
        predicted = delta
        if sensor == "range-bearing":
            distance = np.hypot(*delta)
            predicted = np.array([distance, np.arctan2(delta[1], delta[0])])
            A = np.array([delta / distance, np.array([-delta[1], delta[0]]) / distance**2])
        B = A @ to_body
        H[rows, :2], H[rows, columns], H[rows, 2] = -B, B, B @ np.array([offset[1], -offset[0]])
        v[rows] = values[a] - predicted
        if sensor == "range-bearing":
            v[2 * a + 1] = long_wrap(v[2 * a + 1])
    return v, H
