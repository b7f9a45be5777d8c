"""Estimate the memory of a request before any work begins, and refuse a request that does not fit."""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.arrays import distinct
from slamgauge.compare.estimators.registry import FILTERS, GRAPHS, UNDER
from slamgauge.compare.estimators.requests import Asked, BuiltIn
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.memory import require_memory
from slamgauge.recording import Recording

ESTIMATE_BYTES = 165  # for an estimate and its score, per step (docs/limits.md)
SERIES_BYTES = 88  # for one run and one estimator, per step: 11 series


def require_room_for_runs(runs: int, scenario: Scenario, estimators: int) -> None:
    """Refuse runs whose series do not fit into memory; the summary of a study loads all of them.

    Raises:
        UserError: they do not fit.
    """
    poses = len(scenario.trajectory.stamps(scenario.prior.mean))
    what = f"runs: to sum up {runs} of {poses - 1} steps and {estimators} estimators"
    needed = float(SERIES_BYTES) * runs * poses * (estimators + 1)  # the series of one estimator are loaded twice
    require_memory(needed, what, "give fewer runs, or a shorter trajectory.duration")


def require_room_for_estimates(recording: Recording, asked: Sequence[Asked]) -> None:
    """Refuse estimators whose estimates, filters whose covariance, or graphs whose matrices do not fit into memory.

    Raises:
        UserError: they do not fit.
    """
    what = f"estimators: {len(asked)} of {recording.steps} steps: what they estimate"
    needed = float(ESTIMATE_BYTES) * recording.steps * len(asked)
    require_memory(needed, what, "give fewer, or a shorter run")
    landmarks = 0 if recording.landmark is None else len(distinct(recording.landmark))
    for each in (each for each in asked if isinstance(each, BuiltIn)):
        if each.name in FILTERS:
            what = f"{each.label}: the covariance of {landmarks} landmarks"
            require_memory(8.0 * (3 + 2 * landmarks) ** 2, what, "give fewer landmarks, or leave it out")
        if landmarks and any(each.name.startswith(name) for name in GRAPHS) and UNDER not in each.name:
            from slamgauge.graph_baseline.problem.preparation import prepare  # slow libraries
            from slamgauge.graph_baseline.solver.smoother import require_memory_for

            require_memory_for(prepare(recording), each.name)
