"""Checks with exact measurements: the estimate must equal the truth, whatever the gains are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.check import OtherModelError, Subject, check, landmark_of
from slamgauge.compare.checks.small_recordings import (
    KNOWN_START,
    SIGMA,
    World,
    any_start,
    around,
    at_rest,
    correlated,
    pose_error,
)
from slamgauge.recording import Recording

ARC = (
    "it moves on an arc in each step, where recordings of slamgauge move straight ahead and turn afterwards: a right "
    "model, but biased on them"
)
NEAR = 0.3  # largest difference of a path from arcs, as a share of their difference from straight moves; chords: 0.2
COARSE = 1e3  # sigma [m], [rad] of a channel without weight
EXPLAINED = 1e-3  # share of the error of a mean that remains without the channel that causes it
ROUNDING = 1e-6  # [m], [rad]: a hundredth of a sigma, far above rounding and the tolerance of optimisers


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


def walk(rng: np.random.Generator, landmarks: Float, steps: int = 9, each: int = 1, turn: float = 0.0) -> World:
    """Return a walk from the origin along x with turns of ± `turn` [rad].

    Each scan observes the next `each` landmarks, and starts again after the last one.
    """
    turns = turn * np.array([1, -1, -1, 1, 1, -1, -1, 1, 1])[:steps]
    moves = np.column_stack([rng.uniform(0.3, 0.6, steps), turns])
    return World(
        start=np.zeros(3),
        prior_cov=correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng),
        moves=moves,
        move_sigmas=np.tile([10.0 * SIGMA, 5.0 * SIGMA], (steps, 1)),
        landmarks=landmarks,
        observed=tuple((step, (step * each + k) % len(landmarks)) for step in range(steps + 1) for k in range(each)),
    )


def ahead(rng: np.random.Generator) -> Float:
    """Return three landmarks (3, 2) that stay ahead of a walk from the origin along x."""
    return np.column_stack([rng.uniform(8.0, 10.0, 3), np.array([-5.0, 0.5, 6.0]) + rng.uniform(-0.5, 0.5, 3)])


@check(
    figure="exact measurements of landmarks ahead: largest error of poses and landmarks [m, rad]",
    bound=ROUNDING,
    blame="the mean: motion model, position of a new landmark, or predicted observation; or observations assigned to "
    "the wrong landmark",
)
def truth_recovered(subject: Subject, rng: np.random.Generator) -> float:
    """Walk with turns towards three landmarks; no angle comes near pi.

    Before that, a filter with its own association makes the path alone and observes one landmark twice: in the walk a
    wrong mean would confuse its landmarks. A duplicate landmark counts as an error of 1 m.

    Raises:
        OtherModelError: it moves on arcs, or on their chords, and has no other error.
    """
    world = walk(rng, ahead(rng), turn=rng.uniform(0.1, 0.3))
    found = 0.0
    if subject.ignores("ids"):
        found = max(_error(subject, replace(world, observed=())), _duplicates(subject, any_start(rng), 0.0))
    found = found if found > ROUNDING else _error(subject, world)
    if found > ROUNDING and _moves_on_arcs(subject, world):
        raise OtherModelError(ARC)
    if found > ROUNDING and not subject.ignores("ids", "observation noise"):
        subject.cause = _cause(subject, world, found)
    return found


def _cause(subject: Subject, world: World, error: float) -> str:
    """Return the check of the predicted bearing or range, if the error vanishes without the weight of that channel."""
    for sigmas, name in (([SIGMA, COARSE], "update-bearing"), ([COARSE, SIGMA], "update-range")):
        coarse = world.recording(sigma=np.tile(sigmas, (len(world.observed), 1)))
        if _error(subject, world, coarse) < EXPLAINED * error:
            return name
    return ""


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


CHECKS = (truth_recovered, landmarks_behind, heading_wrap)
