"""Starts from which a minimum is sought, and the lowest that several of them lead to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.special import chdtr

from slamgauge.arrays import Float, Int, Marks
from slamgauge.graph_baseline.problem.preparation import (
    Problem,
    are_inconsistent,
    are_placed,
    are_placed_best,
    are_reobserved,
    landmarks_at_first_observation,
)
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.levenberg_marquardt import (
    Merit,
    Minimum,
    NearMinimum,
    damped_descent,
    newton_minimum,
)
from slamgauge.graph_baseline.solver.motion_elimination import reduce_to_key_poses, restore_poses
from slamgauge.se2 import chain
from slamgauge.sensors import SENSORS

try:
    from slamgauge.graph_baseline.solver.gtsam_start import descend
except ImportError:  # there is no GTSAM for this system
    from slamgauge.graph_baseline.solver.levenberg_marquardt import descend

PORTIONS = 8  # of the recording, in the grown start
SOFTER = (100.0, 10.0)  # times the noise of observations, in the softened start
UNLIKELY = 5e-4  # probability that true noise makes a cost that is taken for too high

Start = Callable[[], tuple[Float, Float]]  # poses (N+1, 3), and landmarks (L, 2) in increasing id order
Starts = Callable[[Problem, Float], Iterable[Start]]  # of a recording and a path (N+1, 3)


def placed_minimum(recording: Problem, path: Float, starts: Starts) -> tuple[Int, Minimum]:
    """The lowest minimum of all that is placed: from a path (N+1, 3) at first, in the end from the minimum itself.

    Bearings that are at odds with the minimum without them may meet in a minimum with them, far from it: that is tried.
    Where nothing is placed at all, it is tried with all landmarks that several poses have seen, then with the one that
    is seen most.

    Returns:
        Association (M,), -1 for what bearings alone do not place, and the minimum without that.
    """
    taken, found = _minimum_of_placed(recording, are_placed(recording, path), path, starts)
    if taken.any():
        hopes = [are_inconsistent(recording, found.poses, ~taken)]
    else:
        again = are_reobserved(recording)
        hopes = [again, of_most_observed(recording.landmark, again)]
    for hopeful in hopes:
        if (hopeful & ~taken).any():
            with suppress(UndeterminedError):
                more, other = _minimum_of_placed(recording, taken | hopeful, found.poses, starts)
                likely = is_low(recording.only(more), other.cost) or not is_low(recording.only(taken), found.cost)
                if likely and more.sum() > taken.sum():
                    taken, found = more, other
    return np.where(taken, recording.landmark, -1), found


def _minimum_of_placed(recording: Problem, taken: Marks, path: Float, starts: Starts) -> tuple[Marks, Minimum]:
    """The lowest minimum of observations `taken` (M,) at first, in the end of those (M,) that it places itself.

    Landmarks are taken in, each once at most, until no more are placed; then those that are not are left out, and so
    are at any time those that the end of a search in vain does not place, or else the half that it places worst.
    """

    def minimum(taken: Marks, path: Float) -> tuple[Marks, Minimum]:
        while True:
            part = recording if taken.all() else recording.only(taken)
            try:
                return taken, lowest_minimum(part, starts(part, path))
            except UndeterminedError as error:
                taken = _placed_after_failure(error, recording, taken)

    taken, found = minimum(taken, path)
    tried, placed = taken, are_placed(recording, found.poses)
    while (placed & ~tried).any():
        tried = tried | placed
        taken, found = minimum(taken | placed, found.poses)
        placed = are_placed(recording, found.poses)
    if (taken & ~placed).any():
        taken, found = minimum(taken & placed, found.poses)
    return taken, found


def _placed_after_failure(error: UndeterminedError, recording: Problem, taken: Marks) -> Marks:
    """Which observations (M,) are taken after a search of those `taken` (M,) has ended in vain; raises if none are."""
    if error.path is None:
        raise error
    left = taken & are_placed(recording, error.path)
    if left.sum() < taken.sum():
        return left
    if SENSORS[recording.sensor].places_landmarks or not (left := are_placed_best(recording, error.path, taken)).any():
        raise error
    return left


def of_most_observed(landmark: Int, among: Marks) -> Marks:
    """Which observations (M,) are of the landmark (M,) that has most of those `among` which it is sought."""
    ids, count = np.unique(landmark[among], return_counts=True)
    return landmark == ids[np.argmax(count)] if len(ids) else among


def lowest_minimum(recording: Problem, starts: Iterable[Start]) -> Minimum:
    """The lowest of the minima that several starts lead to; those after one that is low enough are not tried.

    Raises:
        UndeterminedError: no start leads to one; says what is wrong where the lowest ends.
    """
    near: list[NearMinimum] = []
    mistakes: list[UndeterminedError] = []
    for start in starts:
        try:
            approached = damped_descent(recording, *start())
            if is_low(recording, approached.cost):
                return _newton_minimum(recording, approached)
            near.append(approached)
        except UndeterminedError as error:
            mistakes.append(error)
    near.sort(key=lambda approached: approached.cost)
    unsettled: list[UndeterminedError] = []
    for each in near:
        try:
            return _newton_minimum(recording, each)
        except UndeterminedError as error:
            unsettled.append(error)
    raise [*unsettled, *mistakes][0]


def _newton_minimum(recording: Problem, near: NearMinimum) -> Minimum:
    """`newton_minimum`, whose error says how far the search has come."""
    try:
        return newton_minimum(recording, near)
    except UndeterminedError as error:
        error.path = near.poses
        raise


def is_low(recording: Problem, cost: float) -> bool:
    """Whether half the squared residuals are no more than the stated noise explains: then no lower minimum is due."""
    return explained_by_noise(2.0 * cost, degrees_of_freedom(recording))


def explained_by_noise(chi_square: float, freedom: int) -> bool:
    """Whether squared residuals of so many degrees of freedom are no more than those of true noise."""
    return bool(chdtr(freedom, chi_square) < 1.0 - UNLIKELY) if freedom > 0 else chi_square < 2e-6


def degrees_of_freedom(recording: Problem) -> int:
    """Rows less unknowns: the rows of every observation less two for every landmark."""
    return recording.observation.size - 2 * len(recording.landmark_ids)


def chi_square_of(recording: Problem, poses: Float, landmarks: Float) -> tuple[float, int]:
    """Squared residuals at poses (N+1, 3) and landmarks (L, 2), ids increasing, and their degrees of freedom."""
    return 2.0 * Merit(recording)(poses, landmarks), degrees_of_freedom(recording)


def descent_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """Where Levenberg-Marquardt leads from a path (N+1, 3) on the poses that see something: GTSAM's, or else ours."""
    short, key = reduce_to_key_poses(recording)
    poses, landmarks = descend(short, path[key], landmarks_at_first_observation(recording, path))
    return restore_poses(recording, key, poses), landmarks


def first_guess(recording: Problem) -> tuple[Float, Float]:
    """Poses (N+1, 3) and landmarks (L, 2): the lower of the minima from dead reckoning and the grown start."""
    merit = Merit(recording)
    found = descent_start(recording, recording.dead_reckoning)
    return (
        found
        if is_low(recording, merit(*found))
        else min(found, growing_start(recording), key=lambda each: merit(*each))
    )


def inflated_noise_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """From a path (N+1, 3): observations of far larger noise at first, then of less and less.

    Where they are sharper by orders of magnitude than what is known of the path, steps on their own cost go astray.
    """
    landmarks = landmarks_at_first_observation(recording, path)
    for times in SOFTER:
        soft = replace(recording, observation_cov=times**2 * recording.observation_cov)
        path, landmarks = damped_descent(soft, path, landmarks)[:2]
    return path, landmarks


def growing_start(recording: Problem) -> tuple[Float, Float]:
    """A few iterations on the first portion of the recording, then on more and more of it."""
    short, key = reduce_to_key_poses(recording)
    poses, known = short.prior_mean[None], dict[int, Float]()
    for portion in range(1, PORTIONS + 1):
        part = short.first(short.steps * portion // PORTIONS)
        path = np.concatenate([poses[:-1], chain(poses[-1], part.odometry[len(poses) - 1 :])])
        part = part.only(are_placed(part, path))
        ids = part.landmark_ids
        landmarks = landmarks_at_first_observation(part, path)
        for slot, name in enumerate(ids.tolist()):
            landmarks[slot] = known.get(name, landmarks[slot])
        poses, landmarks = descend(part, path, landmarks, iterations=3)
        known = dict(zip(ids.tolist(), landmarks, strict=True))
    found = landmarks_at_first_observation(short, poses)
    for slot, name in enumerate(short.landmark_ids.tolist()):
        found[slot] = known.get(name, found[slot])
    return restore_poses(recording, key, poses), found
