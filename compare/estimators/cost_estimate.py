"""What a request will take, from its numbers alone, before any work begins: memory is refused, days are asked for.

Hours of one recording are told: nothing else says how far its estimators have come.
"""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.arrays import distinct
from slamgauge.compare.estimators.registry import entry_of
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.errors import UserError
from slamgauge.memory import require_memory
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

LONG, DAY = 600.0, 86_400.0  # s
FILTER, OPTIMUM = 3e-5, 1e-3  # s a step with few landmarks, all else than the update of the map included
PAIR = 2.5e-8  # s a step for every pair of landmarks: that of a filter with 1000 (docs/performance.md)
ESTIMATE_BYTES = 165  # of an estimate and its score, a step (docs/performance.md)
SERIES_BYTES = 88  # of a run and estimator, a step: 11 figures


def require_room_for_runs(runs: int, scenario: Scenario, estimators: int) -> None:
    """Refuse runs whose series, all in memory when they are summed up, do not fit.

    Raises:
        UserError: they do not.
    """
    poses = steps_of(scenario) + 1
    what = f"runs: to sum up {runs} of {poses - 1} steps and {estimators} estimators"
    needed = float(SERIES_BYTES) * runs * poses * (estimators + 1)  # what a store gives is there twice
    require_memory(needed, what, "give fewer runs, or a shorter trajectory.duration")


def steps_of(scenario: Scenario) -> int:
    """Steps of a run."""
    return len(scenario.trajectory.stamps(scenario.prior.mean)) - 1


def require_time_for_runs(
    runs: int, work: Sequence[tuple[Scenario, Sequence[Asked]]], jobs: int, *, agreed: bool
) -> None:
    """Refuse runs, each of all the scenarios with their estimators, that would take days; see `require_time`."""
    each = sum(seconds_of(steps_of(scenario), len(scenario.landmarks.all()), asked) for scenario, asked in work)
    require_time(runs * each / max(jobs, 1), f"runs: {runs} by {jobs} processes", "give fewer", agreed=agreed)


def seconds_of(steps: int, landmarks: int, asked: Sequence[Asked]) -> float:
    """How long estimators take for a recording, to the order of magnitude [s]."""
    graphs = sum(bool(each.name) and entry_of(each.name).takes_associations for each in asked)
    return steps * (graphs * OPTIMUM + (len(asked) - graphs) * FILTER + len(asked) * PAIR * landmarks**2)


def require_means_for_recording(recording: Recording, asked: Sequence[Asked], *, agreed: bool) -> None:
    """Refuse estimators whose estimates memory does not hold, or that would take days; see `require_time`.

    What takes long is told.

    Raises:
        UserError: either.
    """
    landmarks = _landmarks_of(recording)
    what, remedy = f"estimators: {len(asked)} of {recording.steps} steps", "give fewer, or a shorter run"
    require_memory(float(ESTIMATE_BYTES) * recording.steps * len(asked), f"{what}: what they estimate", remedy)
    seconds = sum(seconds_for(recording, each) for each in asked)
    work = f"{what} and {landmarks} landmarks"
    require_time(seconds, work, remedy, agreed=agreed)
    if seconds > LONG:
        tell_once(f"{work} take some {seconds / 3600.0:.1f} h; {remedy}, for less")


def seconds_for(recording: Recording, asked: Asked) -> float:
    """How long an estimator takes for a recording, to the order of magnitude [s].

    The hindsight optimum of ranges and bearings, which is found piece by piece, is counted anew if that would be long.
    """
    seconds = seconds_of(recording.steps, _landmarks_of(recording), [asked])
    entry = entry_of(asked.name) if asked.name else None
    is_batch = entry is not None and entry.takes_associations and entry.kind == "smoothed"
    if seconds > LONG and is_batch and SENSORS[recording.sensor].places_landmarks and recording.landmark is not None:
        from slamgauge.graph_baseline.solver.cost_estimate import seconds_in_hindsight

        return min(seconds, seconds_in_hindsight(recording))
    return seconds


def _landmarks_of(recording: Recording) -> int:
    return 0 if recording.landmark is None else len(distinct(recording.landmark))


def require_time(seconds: float, what: str, remedy: str, *, agreed: bool) -> None:
    """Refuse what takes longer than a day, unless that has been agreed to.

    Args:
        seconds: that it will take.
        what: takes them; it begins with the key to change.
        remedy: what to do instead.
        agreed: whether it shall begin all the same.

    Raises:
        UserError: it would take longer.
    """
    if seconds > DAY and not agreed:
        raise UserError(f"{what} take some {seconds / DAY:.3g} days; {remedy}, or begin all the same with --yes")
