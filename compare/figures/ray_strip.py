"""Strip of frames like figure 4.1 of the exercise: rays begin, lose members, and become landmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from slamgauge.arrays import Float
from slamgauge.compare.figures.axes import label_plane
from slamgauge.compare.figures.map_contents import map_at, map_limits
from slamgauge.compare.figures.map_layers import (
    HEAVIEST,
    MEMBER,
    POINT,
    TRUE_LANDMARK,
    TRUE_ROBOT,
    MapLayer,
    RobotLayer,
    key,
)
from slamgauge.compare.figures.plot_style import LEGEND, MARK_COLOR, Style, printed, sheet, styles
from slamgauge.compare.figures.ray_frames import RayFrame, ray_frames
from slamgauge.display import counted
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

FRAMES = 6
COLUMNS = {"page": 3, "column": 2}
HEADINGS = 0.30  # [in] above and below the panels of a row
FOOT = {"page": 0.75, "column": 1.3}  # [in] for legend and title
ROBOT = 0.035  # size of the robot, relative to the map
LABEL_ROOM = 0.12  # share of the height of a panel; nearer to the top a label is drawn below its point
SURVIVOR: dict[str, Any] = {
    "marker": "s",
    "markersize": 8,
    "linestyle": "none",
    "markerfacecolor": "none",
    "markeredgecolor": MARK_COLOR,
    "markeredgewidth": 0.9,
}


def save_ray_strip(
    folder: Path, truth: Truth | None, recording: Recording, name: str, estimate: Estimate, title: str
) -> None:
    """Write rays.png (200 dpi) and rays.svg into `folder`; the estimate must have rays (`has_rays`)."""
    strip = RayStrip(Truth() if truth is None else truth, recording, name, estimate)
    with printed(folder / "rays", strip.height, title) as figure:
        strip.draw(figure)


class RayStrip:
    """Frames of the rays of an estimate `name`, which has rays (`has_rays`)."""

    def __init__(self, truth: Truth, recording: Recording, name: str, estimate: Estimate) -> None:
        self._truth, self._recording, self._name, self._estimate = truth, recording, name, estimate
        self._frames = ray_frames(estimate, FRAMES)
        self._low, self._high = _limits(truth, estimate, self._frames)
        self._columns = COLUMNS[sheet().width]
        self._rows = -(-len(self._frames) // self._columns)

    @property
    def height(self) -> float:
        """Height of the strip [in]."""
        width, height = (self._high - self._low).tolist()
        panel = sheet().inches / self._columns * float(np.clip(height / width, 0.4, 1.4))
        return self._rows * (panel + HEADINGS) + FOOT[sheet().width]

    def draw(self, figure: FigureBase) -> None:
        """Draw the frames and their legend into an empty figure."""
        low, high, page = self._low, self._high, sheet()
        style = styles([self._name])[self._name]
        grid = figure.subplots(self._rows, self._columns, sharex=True, sharey=True, squeeze=False)
        panels: list[Axes] = list(grid.flat)
        for panel in panels[len(self._frames) :]:
            panel.set_axis_off()
        since = -1
        for panel, frame in zip(panels, self._frames, strict=False):
            panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
            _draw_robots(panel, self._truth, self._estimate, style, ROBOT * float((high - low).max()), frame.step)
            _draw_map(panel, self._truth, self._estimate, style, since, frame)
            panel.set_title(_title(frame, self._recording.stamps), fontsize=5 if page.is_narrow else None)
            since = frame.step
        for panel in panels[: len(self._frames)][-self._columns :]:
            label_plane(panel, y=False)
            panel.tick_params(labelbottom=True)  # the panel below is empty
        for panel in panels[:: self._columns]:
            label_plane(panel, x=False)
        keys, columns = _keys(self._truth, self._name, style), 1 if page.is_narrow else 4
        figure.legend(handles=keys, loc="outside lower center", ncols=columns, **LEGEND)


def _limits(truth: Truth, estimate: Estimate, frames: list[RayFrame]) -> tuple[Float, Float]:
    """Return limits around paths, landmarks and the most likely members in all frames; others as far as possible."""
    end = frames[-1].step + 1
    maps = [map_at(estimate, frame.step) for frame in frames]
    members = np.concatenate([rows.position[rows.member >= 0] for rows in maps])
    sure = [estimate.poses[:end, :2], *(rows.position[(rows.member < 0) | rows.heaviest()] for rows in maps)]
    if truth.poses is not None:
        sure.append(truth.poses[:end, :2])
    sure.append(members if truth.landmarks is None else truth.landmarks)
    return map_limits(sure, [members])


def _draw_robots(ax: Axes, truth: Truth, estimate: Estimate, style: Style, size: float, step: int) -> None:
    """Draw the true and the estimated robot with their paths up to the step."""
    if truth.poses is not None:
        RobotLayer(ax, TRUE_ROBOT, size, filled=False).show(truth.poses[: step + 1])
    cov = None if estimate.pose_covs is None else estimate.pose_covs[step]
    RobotLayer(ax, style, size).show(estimate.poses[: step + 1], cov)


def _draw_map(ax: Axes, truth: Truth, estimate: Estimate, style: Style, since: int, frame: RayFrame) -> None:
    """Draw true landmarks, the map of the frame, and marks around points that were rays at the step `since`."""
    log = estimate.rays
    assert log is not None
    if truth.landmarks is not None:
        ax.plot(*truth.landmarks.T, **TRUE_LANDMARK)
    rows = map_at(estimate, frame.step)
    MapLayer(ax, style.color).show(rows)
    collapsed = log.landmark[(log.survivor >= 0) & (since < log.end) & (log.end <= frame.step)]
    ax.plot(*rows.position[np.isin(rows.landmark, collapsed)].T, **SURVIVOR)
    named = rows.only(rows.landmark == frame.landmark)
    if len(named.weight):
        place = named.position[np.argmax(named.weight)]
        bottom, top = ax.get_ylim()
        below = place[1] > top - LABEL_ROOM * (top - bottom)
        offset, side = ((0, -6), "top") if below else ((0, 6), "bottom")
        text = str(frame.landmark)
        ax.annotate(text, place, offset, textcoords="offset points", ha="center", va=side, clip_on=True, zorder=5)


def _title(frame: RayFrame, stamps: Float) -> str:
    """Return the title of a frame: time, numbers of rays and members, event."""
    counts = f"{counted(frame.rays, 'ray')}, {counted(frame.members, 'member')}"
    moment = f"t = {stamps[frame.step] - stamps[0]:.1f} s, {counts}"
    return f"{moment}\n{frame.caption}"


def _keys(truth: Truth, name: str, style: Style) -> list[Line2D]:
    keys = [key(name, color=style.color, linestyle=style.dashes, linewidth=1.0)]
    if truth.poses is not None:
        keys.append(key("truth", color=TRUE_ROBOT.color, linewidth=1.0))
    if truth.landmarks is not None:
        keys.append(key("true landmark", **TRUE_LANDMARK))
    return [
        *keys,
        key("3σ of a member, dark if likely", color=style.color, **MEMBER),
        key("likeliest member of a ray", color=style.color, **HEAVIEST),
        key("landmark", color=style.color, **POINT),
        key("landmark since the previous frame", **SURVIVOR),
    ]
