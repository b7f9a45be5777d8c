"""Comparison of every filter with its textbook form and, where those two differ, with extended precision.

Differences are in sigmas of the reference: the largest of |d_i| / sigma_i and of |s_i - sigma_i| / sigma_i over poses
and their components. A lower limit of the sigmas makes the bar at least `SPACINGS` spacings of doubles at the position:
a coordinate of 100 km has no digits for 1e-6 of a sigma of 0.01 mm.

Both references start at the origin, which changes only their rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from references.extended import (
    DIGITS_GAINED,
    Long,
    Path,
    as_long,
    extended,
    innovation,
    jacobian,
    long_wrap,
    solved,
)
from references.verdicts import FILTER_BAR, Outcome, attempt
from slamgauge.arrays import Float
from slamgauge.ekf import SlamFilter, ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook_ekf
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import wrap
from tests.reference.textbook import textbook_fej_ekf, textbook_iekf, textbook_oc_ekf, textbook_riekf

SPACINGS = 16
ROUNDINGS = 8  # random roundings of a covariance
ANOTHER_MINIMUM = 1e-3  # sigma; smaller differences belong to the same minimum

Filter = Callable[[Recording], Estimate]


class Pair(NamedTuple):
    """A filter of ours and its textbook form."""

    ours: Filter
    textbook: Filter


PAIRS = {
    "ekf": Pair(ekf_slam, textbook_ekf),
    "fej-ekf": Pair(fej_ekf, textbook_fej_ekf),
    "oc-ekf": Pair(oc_ekf, textbook_oc_ekf),
    "iekf": Pair(iekf, textbook_iekf),
    "riekf": Pair(riekf, textbook_riekf),
}


def judge_filters(recording: Recording) -> list[Outcome]:
    """Return an outcome for each of `PAIRS`, and `iekf minimum`: whether `iekf` ends in a minimum of its cost."""
    if recording.sensor == "bearing":  # rays have no textbook form: the filters must run
        estimates = {name: attempt(pair.ours, recording) for name, pair in PAIRS.items()}
        failed = {
            name: Outcome(name, "failed", math.inf, note) for name, note in estimates.items() if isinstance(note, str)
        }
        return [failed.get(name, Outcome(name, "not compared")) for name in PAIRS]
    return [*(judge_filter(recording, name) for name in PAIRS), judge_minimum(recording)]


def judge_filter(recording: Recording, name: str) -> Outcome:
    """Compare the filter of that name with its references on a recording with ranges and ids.

    A refusal is right where the textbook form is wrong too: double precision is exhausted. Where the textbook form
    loses digits, the filter must be no further from extended precision than the textbook form. The result is undecided
    where extended precision may have lost digits as well, and where `iekf` agrees with it up to an update whose cost
    has several minima, of which both find different ones: `judge_minimum` judges the updates alone.
    """
    estimate = attempt(PAIRS[name].ours, recording)
    textbook = _textbook(recording, name)
    to_textbook = math.inf
    if textbook is not None and not isinstance(estimate, str):
        to_textbook = _apart(estimate, textbook, recording)
    if to_textbook <= FILTER_BAR:
        return Outcome(name, "agrees", to_textbook)
    reference = extended(recording, name)
    if not (np.isfinite(reference.poses).all() and np.isfinite(reference.sigmas).all()):
        return Outcome(name, "undecided", to_textbook, "not even extended precision has an answer")
    lost = math.inf if textbook is None else difference(textbook, reference, recording)
    if isinstance(estimate, str):
        exhausted = textbook is not None and lost > FILTER_BAR  # a textbook form without an answer proves nothing
        return Outcome(name, "undecided" if exhausted else "failed", math.inf, estimate)
    found = _apart(estimate, reference, recording)
    if found <= FILTER_BAR:
        return Outcome(name, "agrees", found, "the textbook form loses digits")
    apart = differences(_path(estimate, recording), reference, recording)
    first = int(np.argmax(~(apart <= FILTER_BAR)))
    same_minimum = name != "iekf" or found < ANOTHER_MINIMUM
    if not same_minimum and apart[first] > ANOTHER_MINIMUM:
        return Outcome(name, "undecided", to_textbook, f"at step {first} extended precision goes to another minimum")
    keeps_digits = lost <= (FILTER_BAR if found <= lost else FILTER_BAR * DIGITS_GAINED)
    if same_minimum and not keeps_digits:
        return Outcome(name, "undecided", found, f"the textbook form is {lost:.1e} sigma from extended precision")
    return Outcome(name, "worse", min(found, to_textbook), f"textbook {to_textbook:.1e}, extended {found:.1e}")


def _apart(estimate: Estimate, reference: Path, recording: Recording) -> float:
    return difference(_path(estimate, recording), reference, recording)


def _textbook(recording: Recording, name: str) -> Path | None:
    """Run the textbook filter from the origin; None where it has no answer."""
    mean = np.array([0.0, 0.0, recording.prior_mean[2]])
    moved = replace(recording, prior_mean=mean)
    with np.errstate(all="ignore"):
        estimate = attempt(PAIRS[name].textbook, moved)
    return None if isinstance(estimate, str) else _path(estimate, moved)


def _path(estimate: Estimate, recording: Recording) -> Path:
    assert estimate.pose_covs is not None
    poses = estimate.poses.copy()
    poses[:, :2] -= recording.prior_mean[:2]
    variances = np.diagonal(estimate.pose_covs, axis1=1, axis2=2)
    return Path(poses, np.sqrt(np.maximum(variances, 0.0)))


def difference(ours: Path, reference: Path, recording: Recording) -> float:
    """Return the largest difference in sigmas of the reference; infinite if a value is not finite."""
    largest = float(differences(ours, reference, recording).max())
    return largest if math.isfinite(largest) else math.inf


def differences(ours: Path, reference: Path, recording: Recording) -> Float:
    """Return the largest difference of each step (N+1,) in sigmas of the reference."""
    farthest = np.abs(reference.poses[:, :2]).max(axis=1) + np.abs(recording.prior_mean[:2]).max()
    magnitude = np.column_stack([farthest, farthest, np.full(len(farthest), np.pi)])
    sigma = np.maximum(reference.sigmas, SPACINGS / FILTER_BAR * np.spacing(magnitude))
    apart = ours.poses - reference.poses
    apart[:, 2] = wrap(apart[:, 2])
    apart, wider = np.abs(apart) / sigma, np.abs(ours.sigmas - reference.sigmas) / sigma
    return np.maximum(apart, wider).max(axis=1)


# --- the minimum of the iterated filter ------------------------------------------------------------


def judge_minimum(recording: Recording, correction: Correction = "iterated") -> Outcome:
    """Compute the length in sigmas of another pass of `iekf` after each of its updates: the gradient of its cost.

    The result is undecided where rounding the covariance before the update changes this length by the bar.
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
    """Update with a scan of mapped landmarks and return the largest component [sigma] of the pass that would follow.

    It is computed in extended precision. The second value is true if rounding the covariance before the update
    changes the first by the bar.
    """
    before, P = as_long(_state(slam)), as_long(slam.cov)
    slam.update(scan)
    after = as_long(_state(slam))
    assert scan.landmark is not None
    order = slam.landmark_ids.tolist()
    columns = [3 + 2 * order.index(name) for name in scan.landmark.tolist()]
    v, H = innovation(sensor, after, columns, as_long(scan.value)), jacobian(sensor, after, columns)
    moved = after - before
    moved[2] = long_wrap(moved[2])
    R = as_long(block_diag(*scan.cov))

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
    """Yield symmetric matrices (n, n) with entries one spacing of doubles above or below those of P."""
    rng, spacing = np.random.default_rng(len(P)), np.spacing(np.abs(P.astype(np.float64)))
    for _ in range(ROUNDINGS):
        rounding = spacing * rng.choice([-1.0, 1.0], P.shape)
        yield P + np.triu(rounding) + np.triu(rounding, 1).T


def _state(slam: SlamFilter) -> Float:
    return np.concatenate([slam.pose, slam.landmarks.ravel()])
