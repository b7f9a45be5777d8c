"""Checks of the mean: the truth from exact measurements, and equivalent estimates from equivalent recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import NotJudgedError, OtherModelError, Subject, check, landmark_of
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    SIGMA,
    World,
    ahead,
    any_start,
    around,
    at_rest,
    correlated,
    pose_error,
    walk,
)
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, rotation

ARC = (
    "it moves on an arc in each step, where recordings of slamgauge move straight ahead and turn afterwards: a right "
    "model, but biased on them"
)
NEAR = 0.3  # largest difference of a path from arcs, as a share of their difference from straight moves; chords: 0.2
COARSE = 1e3  # sigma [m], [rad] of a channel without weight
EXPLAINED = 1e-3  # share of the error of a mean that remains without the channel that causes it
ROUNDING = 1e-6  # [m], [rad]: a hundredth of a sigma, far above rounding and the tolerance of optimisers
NAMES = (7, 2, 40)  # unordered ids with gaps
UNOBSERVED = 40  # steps
LOST = 0.01  # share of the correction after two steps; a smaller one does not count
SAME = 0.05  # sigmas


def _error(subject: Subject, world: World, recording: Recording | None = None) -> float:
    """Return the largest error of poses and landmarks on an exact recording of a world [m, rad]."""
    estimate = subject(world.recording() if recording is None else recording)
    worst = pose_error(estimate.poses, world.poses)
    if len(estimate.landmark_ids):
        names = sorted({name for _, name in world.observed})
        worst = max(worst, *(float(np.abs(landmark_of(estimate, i) - world.landmarks[i]).max()) for i in names))
    return worst


def _duplicates(subject: Subject, start: Float, bearing: float) -> float:
    """Return how many landmarks too many a filter with its own association maps when it observes one twice at rest."""
    if not subject.ignores("ids"):
        return 0.0
    landmark = around(start, np.array([4.0]), np.array([bearing]))
    recording = at_rest(start, KNOWN_START, landmark, ((1, 0), (2, 0))).recording()
    return max(0.0, len(subject(replace(recording, landmark=None)).landmarks) - 1.0)


@check(
    figure="exact measurements of landmarks ahead: largest error of poses and landmarks [m, rad]",
    bound=ROUNDING,
    blame="the mean: motion model, position of a new landmark, or predicted observation; or observations assigned to "
    "the wrong landmark",
)
def truth_recovered(subject: Subject, rng: np.random.Generator) -> float:
    """Walk with turns towards three landmarks; no angle comes near pi.

    Before that, a filter with its own association makes the path alone and observes one landmark twice: in the walk a
    wrong mean, or its own noise, may confuse its landmarks. A duplicate landmark counts as an error of 1 m.

    Raises:
        OtherModelError: it moves on arcs, or on their chords, and has no other error.
    """
    world = walk(rng, ahead(rng), turn=rng.uniform(0.1, 0.3))
    found = 0.0
    if subject.ignores("ids"):
        found = max(_error(subject, replace(world, observed=())), _duplicates(subject, any_start(rng), 0.0))
    subject.is_confused |= found <= ROUNDING and subject.ignores("ids") and subject.ignores("observation noise")
    found = found if found > ROUNDING else _error(subject, world)
    if found > ROUNDING and _moves_on_arcs(subject, world):
        raise OtherModelError(ARC)
    if found > ROUNDING and not subject.ignores("ids", "observation noise"):
        for sigmas, name in (([COARSE, SIGMA], "update-range"), ([SIGMA, COARSE], "update-bearing")):
            coarse = world.recording(sigma=np.tile(sigmas, (len(world.observed), 1)))
            if _error(subject, world, coarse) < EXPLAINED * found:  # it vanishes without the weight of that channel
                subject.cause = name
    return found


def _moves_on_arcs(subject: Subject, world: World) -> bool:
    """Return whether an estimator moves on arcs or their chords, and recovers moves and turns that come apart."""
    alone, arcs = replace(world, observed=()), replace(world, observed=(), is_arc=True)
    poses = subject(alone.recording()).poses
    if pose_error(poses, arcs.poses) > NEAR * pose_error(alone.poses, arcs.poses):
        return False
    apart = (replace(world, moves=world.moves * only) for only in ([1.0, 0.0], [0.0, 1.0]))
    return all(_error(subject, each) <= ROUNDING for each in apart)


@check(
    figure="exact measurements of landmarks behind: largest error of poses and landmarks [m, rad]",
    bound=ROUNDING,
    blame="the predicted bearing: use atan2(dy, dx) - heading, because atan(dy / dx) is wrong for landmarks behind",
    after=("truth-recovered",),
)
def landmarks_behind(subject: Subject, rng: np.random.Generator) -> float:
    """Walk straight away from three landmarks.

    Before that, a filter with its own association observes one landmark twice. A duplicate counts as an error of 1 m.
    """
    bearings = np.array([2.3, -2.3, 2.7]) + rng.uniform(-0.1, 0.1, 3)
    world = walk(rng, around(np.zeros(3), rng.uniform(3.0, 6.0, 3), bearings))
    return _duplicates(subject, np.zeros(3), 2.5) or _error(subject, world)


@check(
    figure="exact measurements over three turns on the spot: largest error of poses and landmarks [m, rad]",
    bound=ROUNDING,
    blame="the wrapping of the heading or of the innovation, which must work for any number of turns",
    excused_to=10.0 * ROUNDING,
    limit="sigma points predict the mean of a curved distribution, which moves the estimate by a few 1e-6; "
    "a wrong wrap causes errors of whole turns",
    after=("innovation-wrap",),
)
def heading_wrap(subject: Subject, rng: np.random.Generator) -> float:
    """Make three turns on the spot; of six landmarks all around, a scan observes the one nearest to straight ahead."""
    turn = rng.choice([-1.0, 1.0]) * rng.uniform(0.45, 0.55)
    start = any_start(rng)
    spread = np.arange(6) * np.pi / 3
    nearest = [int(np.cos(step * turn - spread).argmax()) for step in range(41)]
    order = list(dict.fromkeys(nearest))
    world = World(
        start=start,
        prior_cov=correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng),
        moves=np.tile([0.0, turn], (40, 1)),
        move_sigmas=np.tile([10.0 * SIGMA, 10.0 * SIGMA], (40, 1)),
        landmarks=around(start, rng.uniform(3.0, 6.0, 6), spread[order]),
        observed=tuple((step, order.index(name)) for step, name in enumerate(nearest)),
    )
    return _error(subject, world)


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
    recording = world.recording() if subject.has_own_noise else world.noisy(rng)
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
    recording = walk(rng, ahead(rng)).noisy(rng)
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
    landmarks = before.landmarks @ turn[:2, :2].T + motion[:2]
    return _difference(replace(before, poses=compose(motion, before.poses), landmarks=landmarks), after)


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
    recording = walk(rng, ahead(rng)).noisy(rng)
    estimate = subject(recording)
    if estimate.kind != "filtered":
        raise NotJudgedError("a smoothed estimate may use later measurements")
    ks = (2, 5, recording.steps - 1)
    return max(pose_error(estimate.poses[: k + 1], subject(recording.first(k)).poses) for k in ks) / SIGMA


CHECKS = (truth_recovered, landmarks_behind, heading_wrap)
EQUIVALENCE_CHECKS = (scan_order, permuted_ids, rigid_motion, long_unseen, no_future)
