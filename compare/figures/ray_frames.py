"""Which moments tell what became of the rays of an estimate: they begin, lose members, become points, are lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Int
from slamgauge.compare.figures.map_at_step import map_at
from slamgauge.estimate import Estimate, MapHistory, RayLog


class RayFrame(NamedTuple):
    """A moment, and what has just happened to the rays.

    Attributes:
        step: when.
        caption: the event in a few words; empty if there is none.
        landmark: id of the one whose ray the caption tells of; None if of several or none.
        rays: how many there are.
        members: how many these have together.
    """

    step: int
    caption: str
    landmark: int | None
    rays: int
    members: int


def has_rays(estimate: Estimate) -> bool:
    """Whether the estimate tells of at least one ray, and has noted the map."""
    log, history = estimate.rays, estimate.history
    return log is not None and history is not None and len(log.birth) > 0 and len(history.step) > 0


def ray_frames(estimate: Estimate, count: int) -> list[RayFrame]:
    """At most `count` moments in order: births, members that go, collapses, the first and the last ones first of all.

    Room that is left goes to other events, then to any moments, always far from what is there.
    """
    log, history = estimate.rays, estimate.history
    assert log is not None and history is not None
    noted = np.unique(history.step)
    hero = int(np.lexsort([log.end, log.birth, log.survivor < 0])[0])  # of those that became points the first begun
    chosen = list(dict.fromkeys(_story(log, history, noted, hero)))[:count]
    others = [*_prunings(log, history, noted), *_seen(noted, log.birth), *_seen(noted, log.end[log.survivor >= 0])]
    for candidates in (others, noted[noted > chosen[0]]):
        free = {int(step) for step in candidates} - set(chosen)
        while free and len(chosen) < count:
            chosen.append(max(sorted(free), key=lambda step: min(abs(step - other) for other in chosen)))
            free.remove(chosen[-1])
    return [_frame(estimate, log, noted, step) for step in sorted(chosen)]


def _story(log: RayLog, history: MapHistory, noted: Int, hero: int) -> list[int]:
    """Steps that show the hero's life, and the first and last of what happens to the others."""
    births = _seen(noted, np.sort(log.birth))
    collapses = _seen(noted, np.sort(log.end[log.survivor >= 0]))
    own = _seen(noted, np.array([log.birth[hero], log.end[hero]]))
    ended = own[1:] if log.survivor[hero] >= 0 else own[:0]
    pruned = _prunings(log, history, noted, [hero])
    later, losses = births[births > births[0]], np.sort(log.end[_lost(log)])
    parts = (births[:1], own[:1], ended, collapses[-1:], pruned[:1], pruned[-1:], later[:1], losses[:1])
    return np.concatenate(parts).tolist()


def _seen(noted: Int, events: Int) -> Int:
    """The first noted steps that show what happened at these; the steps themselves after the last one."""
    slot = np.searchsorted(noted, events)
    return np.where(slot < len(noted), noted[slot.clip(max=len(noted) - 1)], events)


def _prunings(log: RayLog, history: MapHistory, noted: Int, rays: Iterable[int] | None = None) -> Int:
    """Noted steps at which a ray, of these or of all, has fewer members than at the one before, and has not ended."""
    found: list[Int] = [noted[:0]]
    for ray in range(len(log.birth)) if rays is None else rays:
        living = noted[(noted >= log.birth[ray]) & ((log.end[ray] < 0) | (noted < log.end[ray]))]
        own = history.step[(history.landmark == log.landmark[ray]) & (history.member >= 0)]
        members = np.searchsorted(own, living, side="right") - np.searchsorted(own, living)
        found.append(living[1:][np.diff(members) < 0])
    return np.concatenate(found)


def _lost(log: RayLog) -> NDArray[np.bool_]:
    return (log.end >= 0) & (log.survivor < 0)


def _frame(estimate: Estimate, log: RayLog, noted: Int, step: int) -> RayFrame:
    rows = map_at(estimate, step)
    members = rows.landmark[rows.member >= 0]
    before = noted[noted < step]
    since = int(before[-1]) if len(before) else -1
    caption, landmark = _latest(estimate, log, since, step)
    return RayFrame(step, caption, landmark, len(np.unique(members)), len(members))


def _latest(estimate: Estimate, log: RayLog, since: int, step: int) -> tuple[str, int | None]:
    """The weightiest kind of event after the step `since`, up to `step`, and its landmark if it is one alone."""
    ended = (since < log.end) & (log.end <= step)
    kinds = (
        (ended & ~_lost(log), "{} rays collapse", "landmark {}: member {} of {} is left"),
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
    """What the rays that are there at both steps have lost."""
    counts: list[dict[int, int]] = []
    for rows in (map_at(estimate, since), map_at(estimate, step)):
        names, members = np.unique(rows.landmark[rows.member >= 0], return_counts=True)
        counts.append(dict(zip(names.tolist(), members.tolist(), strict=True)))
    before, after = counts
    fewer = [name for name in after if after[name] < before.get(name, 0)]
    if len(fewer) == 1:
        return f"landmark {fewer[0]}: {after[fewer[0]]} of {before[fewer[0]]} members are left", fewer[0]
    return f"{len(fewer)} rays lose members" if fewer else "", None
