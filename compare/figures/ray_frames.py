"""Choose the moments that show how the rays of an estimate begin, lose members, collapse or get lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Int
from slamgauge.compare.figures.map_contents import map_at
from slamgauge.estimate import Estimate, MapHistory, RayLog


class RayFrame(NamedTuple):
    """A moment and the latest event of the rays."""

    step: int
    caption: str  # empty without an event
    landmark: int | None  # id of the ray in the caption; None for several rays or no event
    rays: int  # number of rays
    members: int  # number of members of all rays


def has_rays(estimate: Estimate) -> bool:
    """Return whether the estimate logged at least one ray and recorded the map."""
    log, history = estimate.rays, estimate.history
    return log is not None and history is not None and len(log.birth) > 0 and len(history.step) > 0


def ray_frames(estimate: Estimate, count: int) -> list[RayFrame]:
    """Return at most `count` moments in order of time.

    The first and last births, losses of members and collapses have priority. Other events follow, then any recorded
    steps, each as far as possible from the moments chosen before.
    """
    log, history = estimate.rays, estimate.history
    assert log is not None and history is not None
    recorded = np.unique(history.step)
    main_ray = int(np.lexsort([log.end, log.birth, log.survivor < 0])[0])  # the oldest ray that became a point
    chosen = list(dict.fromkeys(_main_events(log, history, recorded, main_ray)))[:count]
    births, collapses = (_first_recorded(recorded, each) for each in (log.birth, log.end[log.survivor >= 0]))
    others = [*_prunings(log, history, recorded), *births, *collapses]
    for candidates in (others, recorded[recorded > chosen[0]]):
        free = {int(step) for step in candidates} - set(chosen)
        while free and len(chosen) < count:
            chosen.append(max(sorted(free), key=lambda step: min(abs(step - other) for other in chosen)))
            free.remove(chosen[-1])
    return [_frame(estimate, log, recorded, step) for step in sorted(chosen)]


def _main_events(log: RayLog, history: MapHistory, recorded: Int, main_ray: int) -> list[int]:
    """Return the steps of the events of the ray `main_ray`, and of the first and last events of the others."""
    births = _first_recorded(recorded, np.sort(log.birth))
    collapses = _first_recorded(recorded, np.sort(log.end[log.survivor >= 0]))
    steps = _first_recorded(recorded, np.array([log.birth[main_ray], log.end[main_ray]]))
    ended = steps[1:] if log.survivor[main_ray] >= 0 else steps[:0]
    pruned = _prunings(log, history, recorded, [main_ray])
    later, losses = births[births > births[0]], np.sort(log.end[_lost(log)])
    parts = (births[:1], steps[:1], ended, collapses[-1:], pruned[:1], pruned[-1:], later[:1], losses[:1])
    return np.concatenate(parts).tolist()


def _first_recorded(recorded: Int, events: Int) -> Int:
    """Return the first recorded steps at or after the events; events after the last record stay as they are."""
    slot = np.searchsorted(recorded, events)
    return np.where(slot < len(recorded), recorded[slot.clip(max=len(recorded) - 1)], events)


def _prunings(log: RayLog, history: MapHistory, recorded: Int, rays: Iterable[int] | None = None) -> Int:
    """Return recorded steps at which a living ray (of `rays` or all) has fewer members than at the previous record."""
    found: list[Int] = [recorded[:0]]
    for ray in range(len(log.birth)) if rays is None else rays:
        living = recorded[(recorded >= log.birth[ray]) & ((log.end[ray] < 0) | (recorded < log.end[ray]))]
        steps = history.step[(history.landmark == log.landmark[ray]) & (history.member >= 0)]
        members = np.searchsorted(steps, living, side="right") - np.searchsorted(steps, living)
        found.append(living[1:][np.diff(members) < 0])
    return np.concatenate(found)


def _lost(log: RayLog) -> NDArray[np.bool_]:
    return (log.end >= 0) & (log.survivor < 0)


def _frame(estimate: Estimate, log: RayLog, recorded: Int, step: int) -> RayFrame:
    rows = map_at(estimate, step)
    members = rows.landmark[rows.member >= 0]
    since = int(recorded[recorded < step].max(initial=-1))
    return RayFrame(step, *_latest(estimate, log, since, step), len(np.unique(members)), len(members))


def _latest(estimate: Estimate, log: RayLog, since: int, step: int) -> tuple[str, int | None]:
    """Return the most important event after the step `since` up to `step`, and its landmark if it concerns one ray."""
    ended = (since < log.end) & (log.end <= step)
    kinds = (
        (ended & ~_lost(log), "{} rays collapse", "landmark {}: member {} of {} remains"),
        (ended & _lost(log), "{} rays are lost", "landmark {} is lost"),
        ((since < log.birth) & (log.birth <= step), "{} rays begin", "landmark {} begins"),
    )
    for happened, several, single in kinds:
        rays = np.flatnonzero(happened)
        if len(rays) > 1:
            return several.format(len(rays)), None
        if len(rays):
            name, at_birth = int(log.landmark[rays[0]]), np.sum(~np.isnan(log.distances[rays[0]]))
            return single.format(name, log.survivor[rays[0]] + 1, at_birth), name
    return _pruned(estimate, since, step)


def _pruned(estimate: Estimate, since: int, step: int) -> tuple[str, int | None]:
    """Return the event of rays that lost members between the two steps, and its landmark if it concerns one ray."""
    counts: list[dict[int, int]] = []
    for rows in (map_at(estimate, since), map_at(estimate, step)):
        names, members = np.unique(rows.landmark[rows.member >= 0], return_counts=True)
        counts.append(dict(zip(names.tolist(), members.tolist(), strict=True)))
    before, after = counts
    fewer = [name for name in after if after[name] < before.get(name, 0)]
    if len(fewer) == 1:
        return f"landmark {fewer[0]}: {after[fewer[0]]} of {before[fewer[0]]} members remain", fewer[0]
    return f"{len(fewer)} rays lose members" if fewer else "", None
