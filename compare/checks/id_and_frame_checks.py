"""Laws of ids, order and frames: two recordings that say the same must be answered alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.checks.exact_measurement_checks import ahead, walk
from slamgauge.compare.checks.law import Answer, Law, NotJudgedError, Subject
from slamgauge.compare.checks.small_recordings import KNOWN_START, SIGMA, World, pose_error
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation

NAMES = np.array([7, 2, 40])  # ids in no order and with gaps
UNSEEN = 40  # steps
SAME = 0.05  # sigmas


def _noisy(world: World, rng: np.random.Generator) -> Recording:
    """A recording of the world whose sights err by their sigmas."""
    return world.recording(rng.normal(0.0, SIGMA, (len(world.sights), 2)))


def _difference(answer: Answer, other: Answer, names: Int | None = None) -> float:
    """Largest difference of poses and landmarks, in sigmas of a sight at 1 m; `names` are the other's ids."""
    worst = pose_error(answer.poses, other.poses)
    if answer.has_map:
        own = range(3)
        pairs = zip(own, own if names is None else names.tolist(), strict=True)
        worst = max(worst, *(float(np.abs(answer.landmark(a) - other.landmark(b)).max()) for a, b in pairs))
    return worst / SIGMA


def _scan_order(subject: Subject, rng: np.random.Generator) -> float:
    """Three landmarks at every step, in the order of their ids and in another that is drawn at every step."""
    recording = _noisy(walk(rng, ahead(rng), steps=2, each=3), rng)
    order = np.concatenate([3 * step + np.roll(range(3), rng.integers(1, 3)) for step in range(3)])
    shuffled = replace(
        recording,
        observation=recording.observation[order],
        landmark=None if recording.landmark is None else recording.landmark[order],
    )
    return _difference(subject(recording), subject(shuffled))


def _permuted_ids(subject: Subject, rng: np.random.Generator) -> float:
    """The same landmarks under other names."""
    recording = _noisy(walk(rng, ahead(rng)), rng)
    renamed = replace(recording, landmark=None if recording.landmark is None else NAMES[recording.landmark])
    return _difference(subject(recording), subject(renamed), NAMES)


def _rigid_motion(subject: Subject, rng: np.random.Generator) -> float:
    """The same world, shifted and turned: so are poses and landmarks."""
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
    disturbance = rng.normal(0.0, SIGMA, (len(here.sights), 2))
    before, after = subject(here.recording(disturbance)), subject(there.recording(disturbance))
    worst = pose_error(after.poses, compose(motion, before.poses))
    if before.has_map:
        for name in range(3):
            moved = turn[:2, :2] @ before.landmark(name) + motion[:2]
            worst = max(worst, float(np.abs(after.landmark(name) - moved).max()))
    return worst / SIGMA


def _long_unseen(subject: Subject, rng: np.random.Generator) -> float:
    """Turning away and back with loose odometry; then a landmark of the start tells how far the robot has turned."""
    there = np.where(np.arange(UNSEEN) < UNSEEN // 2, 0.1, -0.1)
    moves = np.column_stack([np.zeros(UNSEEN + 1), np.append(0.0, there)])
    sigmas = np.zeros_like(moves)
    sigmas[1:, 1] = 10.0 * SIGMA
    slip = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * 10.0 * SIGMA * np.sqrt(UNSEEN)
    world = World(
        start=np.zeros(3),
        prior_cov=KNOWN_START,
        moves=moves,
        move_sigmas=sigmas,
        landmarks=np.array([[rng.uniform(6.0, 9.0), 0.0]]),
        sights=((1, 0), (UNSEEN + 1, 0)),
    )
    answer = subject(world.recording(np.array([[0.0, 0.0], [0.0, -slip]])))
    return float(abs(answer.poses[-1, 2] / slip - 1.0))


def _no_future(subject: Subject, rng: np.random.Generator) -> float:
    """The recording up to step k and the whole of it give the same poses up to k."""
    recording = _noisy(walk(rng, ahead(rng)), rng)
    answer = subject(recording)
    if answer.estimate.kind != "filtered":
        raise NotJudgedError("a smoothed estimate may use the future")
    ks = (2, 5, recording.steps - 1)
    return max(pose_error(answer.poses[: k + 1], subject(recording.first(k)).poses) for k in ks) / SIGMA


BOOKKEEPING = (
    Law(
        name="scan-order",
        figure="three landmarks in a scan in another order: largest difference of poses and landmarks, in sigmas",
        bound=SAME,
        reason="second order, where a filter takes in one observation after the other",
        blame="which landmark an observation of a scan belongs to: its place in the state, looked up for each one anew",
        judge=_scan_order,
    ),
    Law(
        name="permuted-ids",
        figure="the same landmarks under other ids: largest difference of poses and landmarks, in sigmas",
        bound=SAME,
        reason="rounding, and what an optimiser stops at",
        blame="ids taken for places in the state: an id is a name, places follow from the order of first sights",
        judge=_permuted_ids,
    ),
    Law(
        name="rigid-motion",
        figure="the same world shifted and turned: largest difference of poses and landmarks, in sigmas",
        bound=SAME,
        reason="second order, for filters that are not exactly invariant",
        blame="a rotation between body and world that is missing or of another pose, in noise, Jacobians or the mean",
        judge=_rigid_motion,
    ),
    Law(
        name="long-unseen",
        figure="landmark seen again after 40 steps: what the correction leaves of the slip, relative",
        bound=0.02,
        reason="the landmark's and the sight's own sigma leave 1/2000; second order is less",
        blame="landmarks forgotten while out of sight, or begun anew: an id that is mapped is corrected for ever",
        judge=_long_unseen,
    ),
    Law(
        name="no-future",
        figure="poses up to step k from the recording up to k and from all of it, largest difference in sigmas",
        bound=SAME,
        reason="the same numbers go in",
        blame="a pose stored a step late, or smoothed: store it before the next step begins, or say kind='smoothed'",
        judge=_no_future,
    ),
)
