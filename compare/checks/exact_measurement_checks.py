"""Laws on exact measurements: whatever the gains are, the estimate is the truth."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.checks.law import Law, Subject
from slamgauge.compare.checks.small_recordings import SIGMA, World, any_start, around, correlated, pose_error

ROUNDING = 1e-6  # [m], [rad]: a hundredth of a sigma, and far above rounding and what optimisers leave


def _error(subject: Subject, world: World) -> float:
    """Largest error of poses and landmarks on the exact recording [m, rad]."""
    answer = subject(world.recording())
    worst = pose_error(answer.poses, world.poses)
    if answer.has_map:
        seen = sorted({name for _, name in world.sights})
        errors = [np.abs(answer.landmark(name) - world.landmarks[name]).max() for name in seen]
        worst = max(worst, float(max(errors)))
    return worst


def walk(rng: np.random.Generator, landmarks: Float, steps: int = 9, each: int = 1, turn: float = 0.0) -> World:
    """A walk from the origin along x, or winding about it; landmarks are seen in turn, `each` at a step."""
    winding = turn * np.array([1, -1, -1, 1, 1, -1, -1, 1, 1])[:steps]
    moves = np.column_stack([rng.uniform(0.3, 0.6, steps), winding])
    names = [(step, (step * each + k) % len(landmarks)) for step in range(steps + 1) for k in range(each)]
    prior_cov = correlated(SIGMA * np.array([2.0, 2.0, 1.0]), rng)
    return World(
        start=np.zeros(3),
        prior_cov=prior_cov,
        moves=moves,
        move_sigmas=np.tile([10.0 * SIGMA, 5.0 * SIGMA], (steps, 1)),
        landmarks=landmarks,
        sights=tuple(names),
    )


def ahead(rng: np.random.Generator) -> Float:
    """Three landmarks (3, 2) that stay ahead of a walk from the origin along x."""
    return np.column_stack([rng.uniform(8.0, 10.0, 3), np.array([-2.0, 0.5, 3.0]) + rng.uniform(-0.5, 0.5, 3)])


def _recovered(subject: Subject, rng: np.random.Generator) -> float:
    """A winding walk towards three landmarks: no angle comes near the cut at pi."""
    return _error(subject, walk(rng, ahead(rng), turn=rng.uniform(0.1, 0.3)))


def _behind(subject: Subject, rng: np.random.Generator) -> float:
    """A walk straight away from three landmarks."""
    bearings = np.array([2.3, -2.3, 2.7]) + rng.uniform(-0.1, 0.1, 3)
    return _error(subject, walk(rng, around(np.zeros(3), rng.uniform(3.0, 6.0, 3), bearings)))


def _heading_wrap(subject: Subject, rng: np.random.Generator) -> float:
    """Three turns on the spot; of six landmarks all around the one nearest to straight ahead is seen."""
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
        sights=tuple((step, order.index(name)) for step, name in enumerate(nearest)),
    )
    return _error(subject, world)


TRUTH = (
    Law(
        name="truth-recovered",
        figure="exact measurements ahead of the robot: largest error of poses and landmarks [m, rad]",
        bound=ROUNDING,
        reason="rounding, and what an optimiser stops at",
        blame="the mean: motion model, place of a new landmark, or predicted sight; or one landmark taken for another",
        judge=_recovered,
    ),
    Law(
        name="landmarks-behind",
        figure="exact measurements of landmarks behind: largest error of poses and landmarks [m, rad]",
        bound=ROUNDING,
        reason="rounding, and what an optimiser stops at",
        blame="the predicted bearing: atan2(dy, dx) - heading, where atan(dy / dx) knows no behind",
        judge=_behind,
    ),
    Law(
        name="heading-wrap",
        figure="exact measurements over three turns on the spot: largest error of poses and landmarks [m, rad]",
        bound=ROUNDING,
        reason="rounding, and what an optimiser stops at",
        blame="the wrap of the heading, or of the innovation, which must hold whatever number of turns lies between",
        judge=_heading_wrap,
        excused_to=10.0 * ROUNDING,
        limit="sigma points predict the mean of what noise bends (riukf): a few 1e-6 here, where wraps err by turns",
    ),
)
