"""Figure of an animation: its artists are created once and moved from frame to frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from slamgauge.arrays import Float
from slamgauge.compare.figures.axes import label_plane
from slamgauge.compare.figures.map_contents import first_seen, map_at, map_limits, sight_lines
from slamgauge.compare.figures.map_layers import (
    HEAVIEST,
    MEMBER,
    POINT,
    TRUE_LANDMARK,
    TRUE_ROBOT,
    MapLayer,
    RobotLayer,
    draw_path,
    key,
)
from slamgauge.compare.figures.plot_style import LEGEND, MARK_COLOR, Style, styles
from slamgauge.compare.figures.ray_frames import has_rays
from slamgauge.compare.storage.stored_results import Results
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

WIDTH = 5.0  # [in]
DOTS = 120  # per inch: 600 pixels
LEFT, RIGHT, TOP, BOTTOM = 0.5, 0.1, 0.25, 0.4  # [in] around the axes
LEGEND_ROW = 0.17  # [in]
COLUMNS = 3  # columns of the legend
BOTH_WAYS = np.array([-1, 1])
SHAPES = (0.4, 1.0)  # smallest and largest height of the axes, relative to their width
ROBOT = 0.025  # size of the robot, relative to the map
FAINT = 0.5  # opacity of a final map, which has no history


class Scene:
    """Estimates of a run on one axes; `show` moves them to a step."""

    def __init__(
        self,
        results: Results,
        shown: Mapping[str, Estimate],
        mapped: Mapping[str, Estimate],
    ) -> None:
        """Create the artists: paths of the `shown` estimates, robots and maps of the `mapped` ones.

        A map is that of the history, or else the final map.
        """
        self._truth = Truth() if results.truth is None else results.truth
        self._recording = results.recording
        self._shown, self._mapped = shown, mapped
        all_styles = styles(results.estimates)  # same styles as in the figure of the run
        chosen = {name: all_styles[name] for name in shown}
        low, high = limits(results, shown, mapped)
        keys = list(_keys(self._truth, mapped, chosen))
        self.figure, ax, self._time = _layout(low, high, results.title, keys)
        size = ROBOT * float((high - low).max())
        if self._truth.landmarks is not None:
            ax.plot(*self._truth.landmarks.T, **TRUE_LANDMARK)
        self._true_robot = RobotLayer(ax, TRUE_ROBOT, size, filled=False)
        self._robots = {name: RobotLayer(ax, chosen[name], size) for name in mapped}
        self._paths = {name: draw_path(ax, chosen[name]) for name in shown if name not in mapped}
        drawn = [name for name in mapped if mapped[name].history is not None]
        self._maps = {name: MapLayer(ax, chosen[name].color, filled=len(drawn) == 1) for name in drawn}
        self._last_maps = {
            name: ax.plot([], [], color=chosen[name].color, alpha=FAINT, zorder=2.8, **POINT)[0]
            for name in mapped
            if name not in self._maps
        }
        self._first_seen = {name: first_seen(results.recording, mapped[name]) for name in self._last_maps}
        self._sight = LineCollection([], colors=MARK_COLOR, linewidths=0.4, zorder=1)
        ax.add_collection(self._sight, autolim=False)
        self._step = -1

    def show(self, step: int) -> None:
        """Move everything to a step."""
        if self._truth.poses is not None:
            self._true_robot.show(self._truth.poses[: step + 1])
        for name, robot in self._robots.items():
            poses, covs = self._mapped[name].poses, self._mapped[name].pose_covs
            robot.show(poses[: step + 1], None if covs is None else covs[step])
        for name, path in self._paths.items():
            path.set_data(*self._shown[name].poses[: step + 1, :2].T)
        for name, layer in self._maps.items():
            layer.show(map_at(self._mapped[name], step))
        for name, dots in self._last_maps.items():
            dots.set_data(*self._mapped[name].landmarks[self._first_seen[name] <= step].T)
        observer = next(iter(self._mapped.values()))
        self._sight.set_segments(list(sight_lines(self._truth, self._recording, observer, self._step, step)))
        stamps = self._recording.stamps
        self._time.set_text(f"t = {stamps[step] - stamps[0]:.1f} s")
        self._step = step


def limits(results: Results, shown: Mapping[str, Estimate], mapped: Mapping[str, Estimate]) -> tuple[Float, Float]:
    """Return limits around all paths, true landmarks and final maps, and as far as possible around earlier maps."""
    truth = Truth() if results.truth is None else results.truth
    sure = [each[:, :2] for each in (truth.poses, truth.landmarks) if each is not None]
    sure += [estimate.poses[:, :2] for estimate in shown.values()]
    sure += [estimate.landmarks for estimate in mapped.values()]
    passing = [estimate.history.position for estimate in mapped.values() if estimate.history is not None]
    return map_limits(sure, passing)


def _layout(low: Float, high: Float, title: str, keys: list[Line2D]) -> tuple[Figure, Axes, Text]:
    """Create a figure with axes in the shape of the map and a text for the time; the rest is static."""
    across = WIDTH - LEFT - RIGHT
    foot = BOTTOM - (-len(keys) // COLUMNS) * LEGEND_ROW
    shape = float(np.clip((high - low)[1] / (high - low)[0], *SHAPES))
    even = 2 / DOTS  # [in], two pixels: video formats need an even number
    height = even * round((TOP + across * shape + foot) / even)
    figure = Figure(figsize=(WIDTH, height), dpi=DOTS)
    ax = figure.add_axes((LEFT / WIDTH, foot / height, across / WIDTH, 1 - (foot + TOP) / height))
    middle = (low + high) / 2
    sides = np.array([across, height - foot - TOP])
    half = sides * ((high - low) / sides).max() / 2  # equal scales
    ax.set(xlim=middle[0] + half[0] * BOTH_WAYS, ylim=middle[1] + half[1] * BOTH_WAYS)
    label_plane(ax)
    ax.set_title(title, loc="left")
    figure.legend(handles=keys, loc="lower center", ncols=COLUMNS, **LEGEND)
    _freeze(figure, ax)
    above = 1 - (TOP - mpl.rcParams["axes.titlepad"] / 72) / height
    time = figure.text(1 - RIGHT / WIDTH, above, "", ha="right", fontsize=mpl.rcParams["axes.titlesize"])
    return figure, ax, time


def _freeze(figure: Figure, ax: Axes) -> None:
    """Replace title, ticks and legend by an image of them, because drawing them takes most of the time of a frame."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.array(canvas.buffer_rgba())
    figure.legends[0].remove()
    ax.set_title("", loc="left")
    ax.set_axis_off()
    figure.figimage(picture, origin="upper", zorder=-1)


def _keys(truth: Truth, mapped: Mapping[str, Estimate], chosen: Mapping[str, Style]) -> Iterator[Line2D]:
    """Yield legend entries of the artists that exist."""
    if truth.poses is not None:
        yield key("truth", color=TRUE_ROBOT.color, linewidth=1.0)
    for name, style in chosen.items():
        yield key(name, color=style.color, linestyle=style.dashes, linewidth=1.0)
    if truth.landmarks is not None:
        yield key("true landmark", **TRUE_LANDMARK)
    yield key("line of sight", color=MARK_COLOR, linewidth=0.4)
    histories = [estimate for estimate in mapped.values() if estimate.history is not None]
    if histories:
        yield key("mapped landmark", color=MARK_COLOR, **POINT)
    if len(histories) < len(mapped):
        yield key("landmark of the final map", color=MARK_COLOR, alpha=FAINT, **POINT)
    yield key("3σ ellipse", color=MARK_COLOR, **MEMBER)
    if any(has_rays(estimate) for estimate in histories):
        yield key("likeliest member of a ray", color=MARK_COLOR, **HEAVIEST)
