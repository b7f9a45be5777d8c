"""Search for the lowest minimum from several starts."""

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
    landmarks_at_median,
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
from slamgauge.graph_baseline.solver.robust_fit import robust_fit
from slamgauge.graph_baseline.solver.smoother import solve_at
from slamgauge.se2 import chain
from slamgauge.sensors import SENSORS

try:
    from slamgauge.graph_baseline.solver.gtsam_start import descend
except ImportError:  # GTSAM has no wheels for Windows
    from slamgauge.graph_baseline.solver.levenberg_marquardt import descend

PORTIONS = 8  # number of portions in `growing_start`
INFLATION = (100.0, 10.0)  # factors on the standard deviation of observations
UNLIKELY = 5e-4  # probability of a cost that counts as too high, under the stated noise
LONG = 100  # steps; shorter recordings are searched from all starts
ROBUST_STEPS = 15  # damped steps from a robust fit; outliers with bearings near +-pi make the cost jump
SAME = 1e-6  # largest relative difference of the costs of two starts that lead to the same minimum

Start = Callable[[], tuple[Float, Float]]  # poses (N+1, 3), and landmarks (L, 2) in increasing id order
Starts = Callable[[Problem, Float], Iterable[Start]]  # from a problem and a path (N+1, 3)


def placed_minimum(recording: Problem, path: Float, starts: Starts) -> tuple[Int, Minimum]:
    """Return the lowest minimum with the landmarks that their bearings place, first from a path (N+1, 3).

    Landmarks with inconsistent bearings at this minimum are added and tried, because a distant minimum with them may
    fit all bearings. If the minimum places no landmark, all re-observed landmarks are tried, then the most observed
    one.

    Returns:
        Association (M,), -1 for landmarks that their bearings do not place, and the minimum without these landmarks.
    """
    taken, found = _minimum_of_placed(recording, are_placed(recording, path), path, starts)
    if taken.any():
        candidates = [are_inconsistent(recording, found.poses, ~taken)]
    else:
        reobserved = are_reobserved(recording)
        candidates = [reobserved, of_most_observed(recording.landmark, reobserved)]
    for added in candidates:
        if (added & ~taken).any():
            with suppress(UndeterminedError):
                more, other = _minimum_of_placed(recording, taken | added, found.poses, starts)
                likely = is_low(recording.only(more), other.cost) or not is_low(recording.only(taken), found.cost)
                if likely and more.sum() > taken.sum():
                    taken, found = more, other
    return np.where(taken, recording.landmark, -1), found


def _minimum_of_placed(recording: Problem, taken: Marks, path: Float, starts: Starts) -> tuple[Marks, Minimum]:
    """Return the lowest minimum and its observations (M,), starting with the observations `taken` (M,).

    Landmarks that the minimum places are added, each at most once, until there are no more. Then landmarks that it does
    not place are removed. If a search fails, landmarks that its last path does not place are removed, or else the worst
    placed half.
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
    """Return a mask (M,) of the observations to keep after a failed search with `taken` (M,); raise if it is empty."""
    if error.path is None:
        raise error
    left = taken & are_placed(recording, error.path)
    if left.sum() < taken.sum():
        return left
    if SENSORS[recording.sensor].places_landmarks or not (left := are_placed_best(recording, error.path, taken)).any():
        raise error
    return left


def of_most_observed(landmark: Int, among: Marks) -> Marks:
    """Return a mask (M,) of the observations of the landmark that occurs most often in the mask `among` (M,)."""
    ids, count = np.unique(landmark[among], return_counts=True)
    return landmark == ids[np.argmax(count)] if len(ids) else among


def lowest_minimum(recording: Problem, starts: Iterable[Start]) -> Minimum:
    """Return the lowest minimum of several starts, or the first minimum whose cost noise explains.

    Bearings of a short recording may have several minima that noise explains. There the search ends when two starts
    lead to the lowest minimum so far.

    With a sensor that places landmarks the second start is independent of the first. If both lead to the same cost, a
    lower minimum is not expected. The third and last start in a long recording is its robust fit: more starts cannot
    fit data that contradict the model.

    In a long recording a misread id may move a landmark to a pose that observes it, where the cost is not smooth. If no
    start finds a minimum there, the result is the lowest point found.

    Raises:
        UndeterminedError: no start leads to a minimum; the message is that of the start with the lowest cost.
    """
    places_landmarks = SENSORS[recording.sensor].places_landmarks
    may_contradict = recording.steps >= LONG and places_landmarks
    one_suffices = recording.steps >= LONG or places_landmarks
    explained: list[Minimum] = []
    near: list[NearMinimum] = []
    mistakes: list[UndeterminedError] = []
    for start in starts:
        try:
            approached = damped_descent(recording, *start())
            if is_low(recording, approached.cost):
                explained.append(_gauss_newton_minimum(recording, approached))
                if one_suffices or _is_lowest(explained):
                    break
            else:
                near.append(approached)
        except UndeterminedError as error:
            mistakes.append(error)
        if len(near) == 2 and places_landmarks:
            if abs(near[0].cost - near[1].cost) <= SAME * near[0].cost:
                break
            if may_contradict:
                near.append(damped_descent(recording, *robust_fit(recording)[:2], ROBUST_STEPS))
                break
    if explained:
        return min(explained, key=lambda minimum: minimum.cost)
    near.sort(key=lambda approached: approached.cost)
    unsettled: list[UndeterminedError] = []
    for each in near:
        try:
            return _gauss_newton_minimum(recording, each)
        except UndeterminedError as error:
            unsettled.append(error)
    if near and may_contradict:
        poses, landmarks, cost, _ = near[0]
        return Minimum(poses, landmarks, solve_at(recording, poses, landmarks), cost)
    raise [*unsettled, *mistakes][0]


def _is_lowest(minima: list[Minimum]) -> bool:
    """Return whether the lowest of the minima is zero or was found twice."""
    first, second = sorted([*(minimum.cost for minimum in minima), np.inf])[:2]
    return first <= SAME or second - first <= SAME * max(first, 1.0)


def _gauss_newton_minimum(recording: Problem, near: NearMinimum) -> Minimum:
    """Return `gauss_newton_minimum`; its error gets the path from which it started."""
    try:
        return gauss_newton_minimum(recording, near)
    except UndeterminedError as error:
        error.path = near.poses
        raise


def is_low(recording: Problem, cost: float) -> bool:
    """Return whether noise explains the cost (half the squared residuals), so that no lower minimum is expected."""
    return explained_by_noise(2.0 * cost, degrees_of_freedom(recording))


def explained_by_noise(chi_square: float, freedom: int) -> bool:
    """Return whether squared residuals pass a chi-square test with `freedom` degrees of freedom."""
    return bool(chdtr(freedom, chi_square) < 1.0 - UNLIKELY) if freedom > 0 else chi_square < 2e-6


def degrees_of_freedom(recording: Problem) -> int:
    """Return the number of measured values minus two for every landmark."""
    return recording.observation.size - 2 * len(recording.landmark_ids)


def chi_square_of(recording: Problem, poses: Float, landmarks: Float) -> tuple[float, int]:
    """Return squared residuals at poses (N+1, 3) and landmarks (L, 2), ids increasing, and degrees of freedom."""
    return 2.0 * Merit(recording)(poses, landmarks), degrees_of_freedom(recording)


def descent_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """Return poses and landmarks after Levenberg-Marquardt from a path (N+1, 3), on the poses with observations.

    The optimiser is GTSAM's, or `levenberg_marquardt.descend` if GTSAM is not installed.
    """
    short, key = reduce_to_key_poses(recording)
    poses, landmarks = descend(short, path[key], landmarks_at_median(recording, path))
    return restore_poses(recording, key, poses), landmarks


def first_guess(recording: Problem) -> tuple[Float, Float]:
    """Return poses (N+1, 3) and landmarks (L, 2): the better start from dead reckoning or `growing_start`."""
    merit = Merit(recording)
    found = descent_start(recording, recording.dead_reckoning)
    if is_low(recording, merit(*found)):
        return found
    return min(found, growing_start(recording), key=lambda each: merit(*each))


def inflated_noise_start(recording: Problem, path: Float) -> tuple[Float, Float]:
    """Return poses and landmarks after damped steps from a path (N+1, 3) with inflated observation noise.

    The inflation is reduced once. Steps on the exact cost diverge if observations are more precise than the path by
    orders of magnitude.
    """
    landmarks = landmarks_at_median(recording, path)
    for times in INFLATION:
        soft = replace(recording, observation_cov=times**2 * recording.observation_cov)
        path, landmarks = damped_descent(soft, path, landmarks)[:2]
    return path, landmarks


def growing_start(recording: Problem) -> tuple[Float, Float]:
    """Return poses and landmarks after a few iterations on each of 1, 2, ..., PORTIONS portions of the recording."""
    short, key = reduce_to_key_poses(recording)
    poses, known = short.prior_mean[None], dict[int, Float]()
    for portion in range(1, PORTIONS + 1):
        part = short.first(short.steps * portion // PORTIONS)
        path = np.concatenate([poses[:-1], chain(poses[-1], part.odometry[len(poses) - 1 :])])
        part = part.only(are_placed(part, path))
        ids = part.landmark_ids
        landmarks = landmarks_at_median(part, path)
        for slot, name in enumerate(ids.tolist()):
            landmarks[slot] = known.get(name, landmarks[slot])
        poses, landmarks = descend(part, path, landmarks, iterations=3)
        known = dict(zip(ids.tolist(), landmarks, strict=True))
    found = landmarks_at_median(short, poses)
    for slot, name in enumerate(short.landmark_ids.tolist()):
        found[slot] = known.get(name, found[slot])
    return restore_poses(recording, key, poses), found
