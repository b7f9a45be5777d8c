"""Comparison of every filter with its textbook form, and of `iekf` with the minimum of its cost.

Differences are in sigmas of the reference: the largest of |d_i| / sigma_i and of |s_i - sigma_i| / sigma_i over poses
and their components. A lower limit of the sigmas makes the bar at least `SPACINGS` spacings of doubles at the position:
a coordinate of 100 km has no digits for 1e-6 of a sigma of 0.01 mm.

The textbook filters start at the origin, which changes only their rounding. They run a second time in a turned frame:
the difference of both runs shows how many digits they lose.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf import SlamFilter, ekf_slam, fej_ekf, iekf, oc_ekf, riekf, textbook, textbook_ekf
from slamgauge.ekf.maps.correction_table import Correction
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Observations, Recording
from slamgauge.se2 import pose_rotation, wrap
from tests.reference.agreement import FILTER_BAR, Outcome, attempt
from tests.reference.textbook import textbook_fej_ekf, textbook_iekf, textbook_oc_ekf, textbook_riekf

SPACINGS = 16
TURN = 1.0  # rad, of the second run
ROUNDINGS = 8  # random roundings of a covariance
ANOTHER_MINIMUM = 1e-3  # sigma; smaller differences belong to the same minimum


class Path(NamedTuple):
    """Poses (N+1, 3) relative to the prior's mean position, and sigmas (N+1, 3) of the additive error."""

    poses: Float
    sigmas: Float


PAIRS: dict[str, tuple[Estimator, Estimator]] = {  # our filter and its textbook form
    "ekf": (ekf_slam, textbook_ekf),
    "fej-ekf": (fej_ekf, textbook_fej_ekf),
    "oc-ekf": (oc_ekf, textbook_oc_ekf),
    "iekf": (iekf, textbook_iekf),
    "riekf": (riekf, textbook_riekf),
}


def judge_filters(recording: Recording) -> list[Outcome]:
    """Return an outcome for each of `PAIRS`, and `iekf minimum`: whether `iekf` ends in a minimum of its cost."""
    if recording.sensor == "bearing":  # rays have no textbook form: the filters must run
        notes = {name: attempt(ours, recording) for name, (ours, _) in PAIRS.items()}
        return [
            Outcome(name, "failed", math.inf, note) if isinstance(note, str) else Outcome(name, "not compared")
            for name, note in notes.items()
        ]
    return [*(judge_filter(recording, name) for name in PAIRS), judge_minimum(recording)]


def judge_filter(recording: Recording, name: str) -> Outcome:
    """Compare the filter of that name with its textbook form on a recording with ranges and ids.

    The result is undecided where the textbook form loses digits, and where an update of `iekf` has several minima, of
    which both find different ones: `judge_minimum` judges the updates alone.
    """
    estimate = attempt(PAIRS[name][0], recording)
    reference, turned = (_textbook(recording, name, turn) for turn in (0.0, TURN))
    if reference is None or turned is None:
        return Outcome(name, "undecided", math.inf, "the textbook form has no answer")
    lost = float(differences(turned, reference, recording).max())
    if isinstance(estimate, str):
        return Outcome(name, "failed" if lost <= FILTER_BAR else "undecided", math.inf, estimate)
    apart = differences(_path(estimate, np.append(recording.prior_mean[:2], 0.0)), reference, recording)
    largest = float(apart.max())
    if largest <= FILTER_BAR:
        return Outcome(name, "agrees", largest)
    if not lost <= FILTER_BAR:
        return Outcome(name, "undecided", largest, f"the textbook form loses digits: {lost:.1e} sigma")
    first = int(np.argmax(~(apart <= FILTER_BAR)))
    if name == "iekf" and apart[first] > ANOTHER_MINIMUM:
        return Outcome(name, "undecided", largest, f"at step {first} the textbook form goes to another minimum")
    return Outcome(name, "worse", largest, f"from step {first} on")


def _textbook(recording: Recording, name: str, turn: float) -> Path | None:
    """Run the textbook filter from the origin in a frame turned by `turn` [rad]; None where it has no answer."""
    T = pose_rotation(turn)
    mean = np.array([0.0, 0.0, wrap(recording.prior_mean[2] + turn)])
    moved = replace(recording, prior_mean=mean, prior_cov=T @ recording.prior_cov @ T.T)
    with np.errstate(all="ignore"):
        estimate = attempt(PAIRS[name][1], moved)
    return None if isinstance(estimate, str) else _path(estimate, np.append(mean[:2], turn))


def _path(estimate: Estimate, origin: Float) -> Path:
    """Return the path of an estimate relative to an origin (3,) and in its frame."""
    assert estimate.pose_covs is not None
    T = pose_rotation(origin[2])
    poses = (estimate.poses - origin) @ T
    poses[:, 2] = wrap(poses[:, 2])
    return Path(poses, sigmas_of(T.T @ estimate.pose_covs @ T))


def sigmas_of(covs: Float) -> Float:
    """Return standard deviations (n, d) of covariances (n, d, d)."""
    return np.sqrt(np.maximum(np.diagonal(covs, axis1=1, axis2=2), 0.0))


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
    mean = np.array([0.0, 0.0, recording.prior_mean[2]])
    slam = SlamFilter(recording.sensor, mean, recording.prior_cov, correction)
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

    The second value is true if rounding the covariance before the update changes the first by the bar.
    """
    before, P = np.append(slam.pose, slam.landmarks), slam.cov
    slam.update(scan)
    after = np.append(slam.pose, slam.landmarks)
    assert scan.landmark is not None
    order = slam.landmark_ids.tolist()
    slots = np.array([order.index(name) for name in scan.landmark.tolist()], dtype=np.int64)
    v, H, R = textbook.stack(textbook.linearise(sensor, after, slots, scan.value, scan.cov), len(after))
    moved = after - before
    moved[2] = wrap(moved[2])

    def step(P: Float) -> Float:
        return P @ H.T @ np.linalg.solve(H @ P @ H.T + R, v + H @ moved) - moved

    sigma = np.sqrt(np.maximum(np.diag(slam.cov), 0.0))
    sigma = np.maximum(sigma, SPACINGS / FILTER_BAR * np.spacing(np.abs(after).max()))

    def size(step: Float) -> float:
        return float((np.abs(step) / sigma).max())

    left = size(step(P))
    rng, spacing, lost = np.random.default_rng(len(P)), np.spacing(np.abs(P)), False
    for _ in range(ROUNDINGS if left > FILTER_BAR else 0):
        rounding = np.triu(spacing * rng.choice([-1.0, 1.0], P.shape))
        lost = lost or size(step(P + rounding + np.triu(rounding, 1).T) - step(P)) > FILTER_BAR
    return left, lost
