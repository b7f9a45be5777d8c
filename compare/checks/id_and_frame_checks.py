"""Checks of ids, order and frames: equivalent recordings must give equivalent estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.compare.checks.check import NotJudgedError, Subject, check, landmark_of
from slamgauge.compare.checks.exact_measurement_checks import ahead, walk
from slamgauge.compare.checks.small_recordings import SIGMA, World, pose_error
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation

NAMES = (7, 2, 40)  # unordered ids with gaps
UNOBSERVED = 40  # steps
LOST = 0.01  # share of the correction after two steps; a smaller one does not count
SAME = 0.05  # sigmas


def _noisy(world: World, rng: np.random.Generator) -> Recording:
    """Return a recording of the world with noisy observations."""
    return world.recording(rng.normal(0.0, SIGMA, (len(world.observed), 2)))


def _difference(one: Estimate, other: Estimate, names: tuple[int, ...] = (0, 1, 2)) -> float:
    """Return the largest difference of poses and landmarks [sigmas at 1 m]; `names` are the ids in `other`."""
    worst = pose_error(one.poses, other.poses)
    if len(one.landmark_ids):
        pairs = ((landmark_of(one, i), landmark_of(other, name)) for i, name in enumerate(names))
        worst = max(worst, *(float(np.abs(a - b).max()) for a, b in pairs))
    return worst / SIGMA


@check(
    figure="scans of three landmarks in another order: largest difference of poses and landmarks [sigma]",
    bound=SAME,
    blame="the landmark of each observation in a scan: look up its place in the state for every observation",
    after=("permuted-ids", "standing-robot"),
)
def scan_order(subject: Subject, rng: np.random.Generator) -> float:
    """Compare scans in the order of ids with scans in random order.

    The observations are exact for a filter with its own noise: if that is large, the order has a second-order effect.
    """
    world = walk(rng, ahead(rng), steps=2, each=3)
    recording = world.recording() if subject.has_own_noise else _noisy(world, rng)
    order = np.concatenate([3 * step + np.roll(range(3), rng.integers(1, 3)) for step in range(3)])
    ids = np.asarray(recording.landmark)
    shuffled = replace(recording, observation=recording.observation[order], landmark=ids[order])
    return _difference(subject(recording), subject(shuffled))


@check(
    figure="the same landmarks with other ids: largest difference of poses and landmarks [sigma]",
    bound=SAME,
    blame="ids used as places in the state: an id is only a name, the order of first observations gives the place",
    needs=("ids",),
)
def permuted_ids(subject: Subject, rng: np.random.Generator) -> float:
    """Compare ids 0, 1, 2 with other ids."""
    recording = _noisy(walk(rng, ahead(rng)), rng)
    renamed = replace(recording, landmark=np.array(NAMES)[np.asarray(recording.landmark)])
    return _difference(subject(recording), subject(renamed), NAMES)


@check(
    figure="the same world, moved and rotated: largest difference of poses and landmarks [sigma]",
    bound=SAME,
    blame="a rotation between body and world frame that is missing or of another pose, in noise, Jacobians or the mean",
    after=("prediction-jacobian", "odometry-noise-frame", "standing-robot"),
)
def rigid_motion(subject: Subject, rng: np.random.Generator) -> float:
    """Move and rotate start, prior and landmarks; poses and landmarks must move in the same way."""
    here = walk(rng, ahead(rng))
    motion = np.append(rng.uniform(-20.0, 20.0, 2), rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5))
    turn = np.eye(3)
    turn[:2, :2] = rotation(motion[2])
    there = replace(
        here,
        start=compose(motion, here.start),
        prior_cov=turn @ here.prior_cov @ turn.T,
        landmarks=here.landmarks @ turn[:2, :2].T + motion[:2],
    )
    disturbance = rng.normal(0.0, SIGMA, (len(here.observed), 2))
    before, after = subject(here.recording(disturbance)), subject(there.recording(disturbance))
    worst = pose_error(after.poses, compose(motion, before.poses))
    if len(before.landmark_ids):
        for name in range(3):
            moved = turn[:2, :2] @ landmark_of(before, name) + motion[:2]
            worst = max(worst, float(np.abs(landmark_of(after, name) - moved).max()))
    return worst / SIGMA


@check(
    figure="landmark re-observed after 40 steps: share of the heading error that remains",
    bound=0.02,
    blame="landmarks that leave the map while they are not observed, or are initialised twice: correct with every id "
    "in the map",
    after=("update-bearing", "first-sight"),
)
def long_unseen(subject: Subject, rng: np.random.Generator) -> float:
    """Turn away and back with imprecise odometry; the landmark at the start then corrects the heading.

    The correction of a filter with its own noise depends on that noise, also on that of positions: it must only exist.
    """
    error = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * 10.0 * SIGMA * np.sqrt(UNOBSERVED)
    distance = rng.uniform(6.0, 9.0)
    corrected = _corrected_heading(subject, distance, error, UNOBSERVED) / error
    if subject.has_own_noise:
        soon = _corrected_heading(subject, distance, error, 2) / error
        return 0.0 if abs(corrected) > LOST * abs(soon) else 1.0
    return float(abs(corrected - 1.0))


def _corrected_heading(subject: Subject, distance: float, error: float, steps: int) -> float:
    """Return the final heading [rad] after `steps` steps without observations and a bearing with an error [rad]."""
    turns = np.where(np.arange(steps) < steps // 2, 0.1, -0.1)
    moves = np.column_stack([np.zeros(steps + 1), np.append(0.0, turns)])
    sigmas = np.zeros_like(moves)
    sigmas[1:, 1] = 10.0 * SIGMA
    world = World(
        moves=moves,
        move_sigmas=sigmas,
        landmarks=np.array([[distance, 0.0]]),
        observed=((1, 0), (steps + 1, 0)),
    )
    return float(subject(world.recording(np.array([[0.0, 0.0], [0.0, -error]]))).poses[-1, 2])


@check(
    figure="poses up to step k, from the recording up to k and from all of it: largest difference [sigma]",
    bound=SAME,
    blame="a pose stored one step late, or smoothed: store it before the next step begins, or set kind='smoothed'",
)
def no_future(subject: Subject, rng: np.random.Generator) -> float:
    """Compare estimates of the first steps with the estimate of the whole recording."""
    recording = _noisy(walk(rng, ahead(rng)), rng)
    estimate = subject(recording)
    if estimate.kind != "filtered":
        raise NotJudgedError("a smoothed estimate may use later measurements")
    ks = (2, 5, recording.steps - 1)
    return max(pose_error(estimate.poses[: k + 1], subject(recording.first(k)).poses) for k in ks) / SIGMA


CHECKS = (scan_order, permuted_ids, rigid_motion, long_unseen, no_future)
