"""Map of a run at a step: its artists are created once and moved from step to step."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from slamgauge.arrays import Float
from slamgauge.compare.figures.map_contents import first_seen, map_at, map_limits, sight_lines
from slamgauge.compare.figures.map_layers import (
    NO_PLACES,
    POINT,
    TRUE_ROBOT,
    MapLayer,
    RobotLayer,
    draw_path,
    draw_true_landmarks,
    explain,
)
from slamgauge.compare.figures.plot_style import MARK_COLOR, styles
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import Estimate
from slamgauge.truth import Truth

ROBOT = 0.03  # size of the robot, relative to the map
FAINT = 0.5  # opacity of a final map, which has no history


class Scene:
    """Estimates of a run on axes; `show` moves them to a step."""

    def __init__(
        self,
        ax: Axes,
        results: Results,
        shown: Mapping[str, Estimate],
        mapped: Mapping[str, Estimate],
        last: int | None = None,
    ) -> None:
        """Create the artists: paths of the `shown` estimates, robots and maps of the `mapped` ones.

        A map is that of the history, or else the final map. The axes contain the paths up to the step `last`.
        """
        self._truth = Truth() if results.truth is None else results.truth
        self._recording = results.recording
        self._shown, self._mapped = shown, mapped
        self._step = -1
        chosen = styles(results.estimates)  # same styles as in the figure of the run
        low, high = limits(results, shown, mapped, last)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
        size = ROBOT * float((high - low).max())
        draw_true_landmarks(ax, self._truth.landmarks)
        self._true_robot = None if self._truth.poses is None else RobotLayer(ax, TRUE_ROBOT, size, "truth")
        self._robots = {name: RobotLayer(ax, chosen[name], size, name) for name in mapped}
        self._paths = {name: draw_path(ax, NO_PLACES, chosen[name], name) for name in shown if name not in mapped}
        self._maps = {name: MapLayer(ax, chosen[name].color) for name in mapped if mapped[name].history is not None}
        faint = [name for name in mapped if name not in self._maps]
        self._last_maps = {
            name: ax.plot([], [], color=chosen[name].color, alpha=FAINT, zorder=2.8, **POINT)[0] for name in faint
        }
        self._first_seen = {name: first_seen(results.recording, mapped[name]) for name in faint}
        self._sight = LineCollection([], colors=MARK_COLOR, linewidths=0.4, zorder=1)
        ax.add_collection(self._sight, autolim=False)
        ax.plot([], [], color=MARK_COLOR, linewidth=0.4, label="line of sight")
        explain(ax, ellipses=True)

    def show(self, step: int) -> None:
        """Move everything to a step."""
        if self._true_robot is not None and self._truth.poses is not None:
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
        self._sight.set_segments(list(sight_lines(self._recording, observer, self._step, step)))
        self._step = step


def limits(
    results: Results, shown: Mapping[str, Estimate], mapped: Mapping[str, Estimate], last: int | None = None
) -> tuple[Float, Float]:
    """Return limits around paths up to the step `last` and landmarks, and as far as possible around earlier maps."""
    truth, end = Truth() if results.truth is None else results.truth, None if last is None else last + 1
    sure = [] if truth.poses is None else [truth.poses[:end, :2]]
    sure += [estimate.poses[:end, :2] for estimate in shown.values()]
    sure += [estimate.landmarks for estimate in mapped.values()] if truth.landmarks is None else [truth.landmarks]
    passing = [estimate.history.position for estimate in mapped.values() if estimate.history is not None]
    return map_limits(sure, passing)
