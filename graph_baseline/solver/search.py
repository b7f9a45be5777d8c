"""Search for the lowest minimum from a few starts, and for the landmarks that bearings place there."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress

import numpy as np
from scipy.special import chdtr

from slamgauge.arrays import Float, Int, Marks
from slamgauge.graph_baseline.problem.objective import Objective, Point
from slamgauge.graph_baseline.problem.placement import are_placed
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.solver.levenberg_marquardt import (
    Minimum,
    damped_descent,
    gauss_newton_minimum,
    solved_at,
)
from slamgauge.sensors import SENSORS

UNLIKELY = 5e-4  # probability of a cost that counts as too high, under the stated noise
LONG = 100  # steps; bearings of shorter recordings may have several minima that noise explains
SAME_COST = 1e-6  # largest relative difference of the costs of two starts that lead to the same minimum

Start = Callable[[], tuple[Float, Float]]  # poses (N+1, 3), and landmarks (L, 2) in increasing id order
Starts = Callable[[Problem, Float], Iterable[Start]]  # from a problem and a path (N+1, 3)


def placed_minimum(problem: Problem, path: Float, starts: Starts) -> tuple[Int, Minimum]:
    """Return the lowest minimum with the landmarks that their bearings place, first from a path (N+1, 3).

    Landmarks that the minimum places are added, each at most once, until there are no more. Then landmarks that it does
    not place are removed. If a search fails, landmarks that its last path does not place are removed.

    Returns:
        Association (M,), -1 for landmarks that their bearings do not place, and the minimum without these landmarks.
    """

    def minimum(taken: Marks, path: Float) -> tuple[Marks, Minimum]:
        while True:
            part = problem if taken.all() else problem.only(taken)
            try:
                return taken, lowest_minimum(part, starts(part, path))
            except UndeterminedError as error:
                taken = _placed_after_failure(error, problem, taken)

    taken, found = minimum(are_placed(problem, path), path)
    tried, placed = taken, are_placed(problem, found.poses)
    while (placed & ~tried).any():
        tried = tried | placed
        taken, found = minimum(taken | placed, found.poses)
        placed = are_placed(problem, found.poses)
    if (taken & ~placed).any():
        taken, found = minimum(taken & placed, found.poses)
    return np.where(taken, problem.landmark, -1), found


def _placed_after_failure(error: UndeterminedError, problem: Problem, taken: Marks) -> Marks:
    """Return a mask (M,) of the observations to keep after a failed search with `taken` (M,); raise if it is empty."""
    if error.path is None:
        raise error
    left = taken & are_placed(problem, error.path)
    if left.sum() == taken.sum():
        raise error
    return left


def lowest_minimum(problem: Problem, starts: Iterable[Start]) -> Minimum:
    """Return the first minimum whose cost noise explains, or else the lowest minimum of all starts.

    Bearings of a short recording may have several minima that noise explains. There the search ends when two starts
    have led to the lowest minimum so far. If two starts lead to the same cost, more starts are not tried: no path and
    map fits data that contradict the model. In such data a misread id may move a landmark to a pose that observes it,
    where the cost is not smooth; then the result is the lowest point found.

    Raises:
        UndeterminedError: no start leads to a minimum; the message is that of the start with the lowest cost.
    """
    objective, one_suffices = Objective(problem), problem.steps >= LONG or SENSORS[problem.sensor].places_landmarks
    explained: list[Minimum] = []
    near: list[Point] = []
    mistakes: list[UndeterminedError] = []
    for start in starts:
        try:
            point = damped_descent(objective, *start())
            if is_low(problem, point.cost):
                explained.append(_minimum_at(objective, point))
                if one_suffices or _is_lowest(explained):
                    break
            else:
                near.append(point)
        except UndeterminedError as error:
            mistakes.append(error)
        if one_suffices and len(near) == 2 and abs(near[0].cost - near[1].cost) <= SAME_COST * near[0].cost:
            break
    if explained:
        return min(explained, key=lambda minimum: minimum.cost)
    near.sort(key=lambda point: point.cost)
    unsettled: list[UndeterminedError] = []
    for each in near:
        try:
            return _minimum_at(objective, each)
        except UndeterminedError as error:
            unsettled.append(error)
    if near and one_suffices:
        with suppress(UndeterminedError):
            return Minimum(near[0].poses, near[0].landmarks, solved_at(objective, near[0]), near[0].cost)
    raise [*unsettled, *mistakes][0]


def _is_lowest(minima: list[Minimum]) -> bool:
    """Return whether the lowest of the minima is zero or was found twice."""
    first, second = sorted([*(minimum.cost for minimum in minima), np.inf])[:2]
    return first <= SAME_COST or second - first <= SAME_COST * max(first, 1.0)


def _minimum_at(objective: Objective, point: Point) -> Minimum:
    """Return `gauss_newton_minimum`; its error gets the path from which it started."""
    try:
        return gauss_newton_minimum(objective, point)
    except UndeterminedError as error:
        error.path = point.poses
        raise


def is_low(problem: Problem, cost: float) -> bool:
    """Return whether noise explains the cost (half the squared residuals), so that no lower minimum is expected."""
    return explained_by_noise(2.0 * cost, degrees_of_freedom(problem))


def explained_by_noise(chi_square: float, freedom: int) -> bool:
    """Return whether squared residuals pass a chi-square test with `freedom` degrees of freedom."""
    return bool(chdtr(freedom, chi_square) < 1.0 - UNLIKELY) if freedom > 0 else chi_square < 2e-6


def degrees_of_freedom(problem: Problem) -> int:
    """Return the number of measured values minus two for every landmark."""
    return problem.observation.size - 2 * len(problem.landmark_ids)
