"""Strip of frames like figure 4.1 of the exercise: the rays of an estimate begin, lose members, and become points."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import FigureBase

from slamgauge.compare.figures.maps import Scene, map_at
from slamgauge.compare.figures.plot_style import legend_below, printed, sheet
from slamgauge.compare.storage.files import Results
from slamgauge.display import counted
from slamgauge.estimate import Estimate

FRAMES, OF_ONE_RAY = 6, 4  # all frames, and those of the ray that the titles follow
COLUMNS = {"page": 3, "column": 2}
HEADINGS, FOOT = 0.5, 0.6  # [in] above and below the panels of a row; for legend and title


class RayFrame(NamedTuple):
    """A moment of the rays."""

    step: int
    landmark: int  # id of the ray that the captions follow
    caption: str


def has_rays(estimate: Estimate) -> bool:
    """Return whether the estimate logged at least one ray and recorded the map."""
    log, history = estimate.rays, estimate.history
    return log is not None and history is not None and len(log.birth) > 0 and len(history.step) > 0


def ray_frames(estimate: Estimate) -> list[RayFrame]:
    """Return moments at which the oldest ray that became a point changes, and others up to the end of all rays."""
    log, history = estimate.rays, estimate.history
    assert log is not None and history is not None
    ray = np.lexsort([-log.end, log.birth, log.survivor < 0])[0]
    name, recorded = int(log.landmark[ray]), np.unique(history.step)
    members = np.array([_members(estimate, int(step), name) for step in recorded])
    chosen = _spread(recorded[np.diff(members, prepend=-1) != 0], OF_ONE_RAY)
    last = recorded[-1] if (log.end < 0).any() else max(log.end.max(), *chosen)
    others = np.setdiff1d(_spread(recorded[recorded <= last], FRAMES), chosen)
    steps = sorted([*chosen, *_spread(others, FRAMES - len(chosen))])
    return [RayFrame(step, name, _caption(estimate, step, name)) for step in steps]


def _members(estimate: Estimate, step: int, name: int) -> int:
    """Return the number of members of a ray, 0 for a point and -1 if the landmark is not in the map."""
    rows = map_at(estimate, step)
    mine = rows.landmark == name
    return int(np.sum(rows.member[mine] >= 0)) if mine.any() else -1


def _spread(steps: np.ndarray, count: int) -> list[int]:
    """Return at most `count` of the steps, evenly spaced, with both ends."""
    return steps[np.unique(np.linspace(0, len(steps) - 1, min(count, len(steps))).round().astype(int))].tolist()


def _caption(estimate: Estimate, step: int, name: int) -> str:
    rows, members = map_at(estimate, step), _members(estimate, step, name)
    rays = counted(len(np.unique(rows.landmark[rows.member >= 0])), "ray")
    mine = {-1: "not in the map", 0: "a point"}.get(members, counted(members, "member"))
    return f"{rays}; landmark {name}: {mine}"


class RayStrip:
    """Frames of the rays of an estimate `name`, which has rays (`has_rays`); `height` is that of the strip [in]."""

    def __init__(self, results: Results, name: str) -> None:
        """Choose the frames."""
        self._estimate, self._stamps = results.estimates[name], results.recording.stamps
        self._frames, self._columns = ray_frames(self._estimate), COLUMNS[sheet().width]
        self._rows = -(-len(self._frames) // self._columns)
        only = {name: self._estimate}
        self._scene = Scene(results, only, only, self._frames[-1].step)
        width, height = (self._scene.high - self._scene.low).tolist()
        panel = sheet().inches / self._columns * float(np.clip(height / width, 0.4, 1.4))
        self.height = self._rows * (panel + HEADINGS) + FOOT

    def draw(self, figure: FigureBase) -> None:
        """Draw the frames and their legend into an empty figure."""
        panels = list(figure.subplots(self._rows, self._columns, squeeze=False).flat)
        for panel, frame in zip(panels, self._frames, strict=False):
            self._scene.draw(panel, frame.step)
            time = self._stamps[frame.step] - self._stamps[0]
            panel.set_title(f"t = {time:.1f} s\n{frame.caption}", fontsize=5 if sheet().is_narrow else None)
            panel.label_outer()
            rows = map_at(self._estimate, frame.step)
            mine = rows.only(rows.landmark == frame.landmark)
            for place in mine.position[np.argsort(mine.weight)][-1:]:  # the likeliest member
                panel.annotate(str(frame.landmark), place, (0, 5), textcoords="offset points", clip_on=True, zorder=5)
        for panel in panels[len(self._frames) :]:
            panel.set_axis_off()
        legend_below(figure, panels[0].get_legend_handles_labels()[0])


def save_ray_strip(out: Path, results: Results, name: str) -> None:
    """Write rays.png (200 dpi) and rays.svg of an estimate `name` into `out`, if it has rays."""
    strip = RayStrip(results, name)
    with printed(out / "rays", strip.height, f"{results.title}: rays of {name}") as figure:
        strip.draw(figure)
