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
    minimum_at,
)
from slamgauge.sensors import SENSORS

UNLIKELY = 5e-4  # probability of a cost that counts as too high, under the stated noise
LONG = 100  # steps; bearings of shorter recordings may have several minima that noise explains
SAME_COST = 1e-6  # largest difference of the costs of two starts that lead to the same minimum, relative above 1
ALIKE = 1e-3  # the same in long recordings, where more starts would not explain what two leave unexplained

Start = Callable[[], tuple[Float, Float]]  # poses (N+1, 3), and landmarks (L, 2) in increasing id order
Starts = Callable[[Problem, Float], Iterable[Start]]  # from a problem and a path (N+1, 3)


def placed_minimum(problem: Problem, path: Float, starts: Starts) -> tuple[Int, Minimum]:
    """Return the lowest minimum with the landmarks that their bearings place, first from a path (N+1, 3).

    Landmarks that the minimum places are added, each at most once, until there are no more. Then landmarks that it does
    not place are removed.

    Returns:
        Association (M,), -1 for landmarks that their bearings do not place, and the minimum without these landmarks.
    """

    def minimum(taken: Marks, path: Float) -> Minimum:
        part = problem if taken.all() else problem.only(taken)
        return lowest_minimum(part, starts(part, path))

    taken = are_placed(problem, path)
    found = minimum(taken, path)
    placed = are_placed(problem, found.poses)
    while (placed & ~taken).any():
        taken = taken | placed
        found = minimum(taken, found.poses)
        placed = are_placed(problem, found.poses)
    if (taken & ~placed).any():
        taken = taken & placed
        found = minimum(taken, found.poses)
    return np.where(taken, problem.landmark, -1), found


def lowest_minimum(problem: Problem, starts: Iterable[Start]) -> Minimum:
    """Return the lowest minimum of the starts that are tried.

    The search ends if noise explains the cost; bearings of a short recording may have several such minima. It also ends
    if two starts have led to the lowest cost: no path and map fits data that contradict the model. In such data a
    misread id may move a landmark to a pose that observes it, where the cost is not smooth; then the result is the
    lowest point found.

    Raises:
        UndeterminedError: no start leads to a minimum.
    """
    objective, one_suffices = Objective(problem), problem.steps >= LONG or SENSORS[problem.sensor].places_landmarks
    points: list[Point] = []
    mistakes: list[UndeterminedError] = []
    unsettled: list[UndeterminedError] = []
    for start in starts:
        try:
            points.append(damped_descent(objective, *start()))
        except UndeterminedError as error:
            mistakes.append(error)
            continue
        points.sort(key=lambda point: point.cost)
        if _is_found_twice(points, problem.steps) or (one_suffices and is_low(problem, points[0].cost)):
            break
    for point in points:
        try:
            return gauss_newton_minimum(objective, point)
        except UndeterminedError as error:
            unsettled.append(error)
    if points and one_suffices and not is_low(problem, points[0].cost):
        with suppress(UndeterminedError):
            return minimum_at(objective, points[0])
    raise [*unsettled, *mistakes][0]


def _is_found_twice(points: list[Point], steps: int) -> bool:
    """Return whether the lowest cost is zero or that of two points."""
    first, second = [*(point.cost for point in points), np.inf][:2]
    return first <= SAME_COST or second - first <= (SAME_COST if steps < LONG else ALIKE) * max(first, 1.0)


def is_low(problem: Problem, cost: float) -> bool:
    """Return whether noise explains the cost (half the squared residuals), so that no lower minimum is expected."""
    return explained_by_noise(2.0 * cost, degrees_of_freedom(problem))


def explained_by_noise(chi_square: float, freedom: int) -> bool:
    """Return whether squared residuals pass a chi-square test with `freedom` degrees of freedom."""
    return bool(chdtr(freedom, chi_square) < 1.0 - UNLIKELY) if freedom > 0 else chi_square < 2e-6


def degrees_of_freedom(problem: Problem) -> int:
    """Return the number of measured values minus two for every landmark."""
    return problem.observation.size - 2 * len(problem.landmark_ids)
