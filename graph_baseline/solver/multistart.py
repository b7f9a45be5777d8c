"""Starts for the search of a minimum, and the lowest of the minima that they lead to."""

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
    gauss_newton_minimum,
)
from slamgauge.graph_baseline.solver.motion_elimination import reduce_to_key_poses, restore_poses
from slamgauge.se2 import chain
from slamgauge.sensors import SENSORS

try:
    from slamgauge.graph_baseline.solver.gtsam_start import descend
except ImportError:  # GTSAM has no wheels for Windows
    from slamgauge.graph_baseline.solver.levenberg_marquardt import descend

PORTIONS = 8  # number of portions in the growing start
INFLATION = (100.0, 10.0)  # factors on the standard deviation of observations
UNLIKELY = 5e-4  # probability that true noise makes a cost that counts as too high

Start = Callable[[], tuple[Float, Float]]  # poses (N+1, 3), and landmarks (L, 2) in increasing id order
Starts = Callable[[Problem, Float], Iterable[Start]]  # from a problem and a path (N+1, 3)


def placed_minimum(recording: Problem, path: Float, starts: Starts) -> tuple[Int, Minimum]:
    """Return the lowest minimum with all landmarks that bearings place: from a path (N+1, 3), then from the minimum.

    Bearings that are inconsistent at a minimum without them may agree in a distant minimum with them: that is
    tried. If no landmark is placed at all, all re-observed landmarks are tried, then the most observed one.

    Returns:
        Association (M,), -1 for landmarks that bearings do not place, and the minimum without these.
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
    """Return the lowest minimum of observations `taken` (M,), adjusted to those (M,) that it places itself.

    Landmarks are added, each once at most, until no more are placed; then those that are not placed are removed.
    After a failed search, landmarks that its end does not place are removed, or else the half that it places worst.
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
    """Return which observations (M,) remain after a failed search with `taken` (M,); raise if none do."""
    if error.path is None:
        raise error
    left = taken & are_placed(recording, error.path)
    if left.sum() < taken.sum():
        return left
    if SENSORS[recording.sensor].places_landmarks or not (left := are_placed_best(recording, error.path, taken)).any():
        raise error
    return left


def of_most_observed(landmark: Int, among: Marks) -> Marks:
    """Return which observations (M,) belong to the landmark (M,) with the most observations `among` (M,)."""
    ids, count = np.unique(landmark[among], return_counts=True)
    return landmark == ids[np.argmax(count)] if len(ids) else among


def lowest_minimum(recording: Problem, starts: Iterable[Start]) -> Minimum:
    """Return the lowest minimum of several starts; stop at the first that noise explains.

    Raises:
        UndeterminedError: no start leads to a minimum; states the problem at the lowest end.
    """
    near: list[NearMinimum] = []
    mistakes: list[UndeterminedError] = []
    for start in starts:
        try:
            approached = damped_descent(recording, *start())
            if is_low(recording, approached.cost):
                return _gauss_newton_minimum(recording, approached)
            near.append(approached)
        except UndeterminedError as error:
            mistakes.append(error)
    near.sort(key=lambda approached: approached.cost)
    unsettled: list[UndeterminedError] = []
    for each in near:
        try:
            return _gauss_newton_minimum(recording, each)
        except UndeterminedError as error:
            unsettled.append(error)
    raise [*unsettled, *mistakes][0]


def _gauss_newton_minimum(recording: Problem, near: NearMinimum) -> Minimum:
    """Call `gauss_newton_minimum`; its error carries the path that was reached."""
    try:
        return gauss_newton_minimum(recording, near)
    except UndeterminedError as error:
        error.path = near.poses
        raise


def is_low(recording: Problem, cost: float) -> bool:
    """Return whether noise explains half the squared residuals `cost`: then no lower minimum is expected."""
    return explained_by_noise(2.0 * cost, degrees_of_freedom(recording))


def explained_by_noise(chi_square: float, freedom: int) -> bool:
    """Return whether squared residuals with these degrees of freedom are no larger than those of true noise."""
    return bool(chdtr(freedom, chi_square) < 1.0 - UNLIKELY) if freedom > 0 else chi_square < 2e-6


def degrees_of_freedom(recording: Problem) -> int:
    """Return the number of measured values less two for every landmark."""
    return recording.observation.size - 2 * len(recording.landmark_ids)


def chi_square_of(recording: Problem, poses: Float, landmarks: Float) -> tuple[float, int]:
    """Return squared residuals at poses (N+1, 3) and landmarks (L, 2), ids increasing, and degrees of freedom."""
    return 2.0 * Merit(recording)(poses, landmarks), degrees_of_freedom(recording)


def descent_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """Return where Levenberg-Marquardt ends from a path (N+1, 3), on the poses with observations.

    It is GTSAM's where that is installed, else our own.
    """
    short, key = reduce_to_key_poses(recording)
    poses, landmarks = descend(short, path[key], landmarks_at_first_observation(recording, path))
    return restore_poses(recording, key, poses), landmarks


def first_guess(recording: Problem) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2): the lower minimum from dead reckoning and from the growing start."""
    merit = Merit(recording)
    found = descent_start(recording, recording.dead_reckoning)
    return (
        found
        if is_low(recording, merit(*found))
        else min(found, growing_start(recording), key=lambda each: merit(*each))
    )


def inflated_noise_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """Descend from a path (N+1, 3) with observation noise that is inflated at first, then less.

    Steps on the true cost diverge if observations are sharper than the path's uncertainty by orders of magnitude.
    """
    landmarks = landmarks_at_first_observation(recording, path)
    for times in INFLATION:
        soft = replace(recording, observation_cov=times**2 * recording.observation_cov)
        path, landmarks = damped_descent(soft, path, landmarks)[:2]
    return path, landmarks


def growing_start(recording: Problem) -> tuple[Float, Float]:
    """Take a few iterations on the first portion of the recording, then on more and more of it."""
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
