"""Maps of a run at a step: their contents, the limits of their axes, and how they are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba_array
from matplotlib.patches import Polygon

from slamgauge.arrays import Float, Int, Marks, chunks
from slamgauge.compare.figures.curves import LONG
from slamgauge.compare.figures.plot_style import MARK_COLOR, TRUTH_COLOR, Style, styles
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.truth import Truth

NEVER = np.iinfo(np.int64).max
MARGIN = 0.06  # relative to the extent of the map, on each side
ROOM = 0.15  # the same, for positions that may diverge
SHAPE = np.array([[1.0, 0.0], [-0.7, 0.65], [-0.35, 0.0], [-0.7, -0.65]])  # outline of the robot; x points forward
ROBOT = 0.03  # size of the robot, relative to the map
FAINTEST = 0.2  # opacity of a member of weight 0
FILLING = 0.2  # opacity of the inside of a member, relative to its outline
FAINT = 0.5  # opacity of a final map, which has no history
POINT: dict[str, Any] = {"marker": ".", "markersize": 3, "linestyle": "none"}
OUTLINE: dict[str, Any] = {"marker": "o", "markersize": 6, "linestyle": "none", "markerfacecolor": "none"}
CROSS: dict[str, Any] = {"marker": "+", "markersize": 5, "linestyle": "none", "markeredgewidth": 0.8}
TRUE_ROBOT = Style(TRUTH_COLOR, "-")


class MapRows(NamedTuple):
    """Rows of a `MapHistory` at one step; each is a point or a member of a ray."""

    landmark: Int  # (K,) ids
    member: Int  # (K,) numbers of the members along their ray, -1 for a point
    weight: Float  # (K,) probabilities of the members, 1 for a point
    position: Float  # (K, 2) [m]
    cov: Float  # (K, 2, 2) [m^2]

    def only(self, kept: Marks | slice) -> MapRows:
        """Return the rows of a mask (K,) or a slice."""
        return MapRows(
            landmark=self.landmark[kept],
            member=self.member[kept],
            weight=self.weight[kept],
            position=self.position[kept],
            cov=self.cov[kept],
        )


def map_at(estimate: Estimate, step: int) -> MapRows:
    """Return the last map that the history recorded up to a step; empty before the first one.

    Rays that were lost since that record, according to the log of rays, are removed.
    """
    history, log = estimate.history, estimate.rays
    assert history is not None
    end = int(np.searchsorted(history.step, step, side="right"))
    recorded = int(history.step[end - 1]) if end else step
    everything = MapRows(history.landmark, history.member, history.weight, history.position, history.cov)
    rows = everything.only(slice(int(np.searchsorted(history.step, recorded)), end))
    if log is None:
        return rows
    was_recorded = (log.birth <= recorded) & (recorded < log.end)
    lost = was_recorded & (log.end <= step) & (log.survivor < 0)
    is_point, is_lost = rows.member < 0, np.isin(rows.landmark, log.landmark[lost])
    return rows.only(is_point | ~is_lost)


def first_seen(recording: Recording, estimate: Estimate) -> Int:
    """Return the steps (L,) at which the landmarks of the estimate were first observed; 0 if ids are unknown."""
    ids = estimate.landmark_ids
    seen = recording.landmark if estimate.association is None else estimate.association
    if seen is None:
        return np.zeros(len(ids), np.int64)
    steps = np.full(len(ids), NEVER)
    for rows in reversed([*chunks(len(seen))]):
        names, first = np.unique(seen[rows], return_index=True)
        found = np.isin(ids, names)
        steps[found] = recording.observation_step[rows][first[np.searchsorted(names, ids[found])]]
    return steps


def sight_lines(recording: Recording, estimate: Estimate, after: int, step: int) -> Float:
    """Return lines (m, 2, 2) [m] from robot to mapped landmark, for the last scan after the step `after` up to `step`.

    Positions are those of the estimate. Without ids the result is empty.
    """
    seen = recording.landmark if estimate.association is None else estimate.association
    first, last = np.searchsorted(recording.observation_step, [after, step], side="right")
    if first == last or seen is None:
        return np.zeros((0, 2, 2))
    at = int(recording.observation_step[last - 1])
    scan = slice(int(np.searchsorted(recording.observation_step, at)), int(last))
    which = np.nonzero(seen[scan, None] == estimate.landmark_ids)[1]
    start = np.broadcast_to(estimate.poses[at, :2], (len(which), 2))
    return np.stack([start, estimate.landmarks[which]], axis=1)


def map_limits(sure: Sequence[Float], others: Sequence[Float]) -> tuple[Float, Float]:
    """Return corners low and high (2,) [m] around all `sure` positions (n, 2), and the `others` up to a margin.

    Rows of NaN (gaps of a ground truth) are ignored.
    """
    low, high = _corners(sure)
    extent = (high - low).max() or 1.0  # a single position needs an extent too
    lowest, highest = _corners([*sure, *others])
    low = np.maximum(lowest, low - ROOM * extent) - MARGIN * extent
    high = np.minimum(highest, high + ROOM * extent) + MARGIN * extent
    return low, high


def _corners(places: Sequence[Float]) -> tuple[Float, Float]:
    """Return the smallest and the largest coordinates (2,) of positions (n, 2), without copying these."""
    low = [np.fmin.reduce(each, axis=0, initial=np.inf) for each in places]
    high = [np.fmax.reduce(each, axis=0, initial=-np.inf) for each in places]
    return np.min(low, axis=0), np.max(high, axis=0)


def draw_path(ax: Axes, places: Float, style: Style, label: str) -> None:
    """Draw the path through positions (n, 2) [m]."""
    look: dict[str, Any] = {"color": style.color, "linestyle": style.dashes, "linewidth": 1.0, "zorder": 2.5}
    ax.plot(*places.T, label=label, rasterized=len(places) > LONG, **look)


def draw_true_landmarks(ax: Axes, places: Float | None) -> None:
    """Draw crosses at positions (L, 2) [m], if there are any."""
    if places is not None:
        ax.plot(*places.T, color=TRUTH_COLOR, label="true landmark", zorder=3, **CROSS)


def explain(ax: Axes, *, ellipses: bool) -> None:
    """Add legend entries for mapped landmarks and ellipses, in grey: they have the colours of their estimators."""
    ax.plot([], [], color=MARK_COLOR, label="mapped landmark", **POINT)
    if ellipses:
        ax.plot([], [], color=MARK_COLOR, markeredgewidth=0.5, label="3σ ellipse", **OUTLINE)


def draw_ellipses(ax: Axes, centers: Float, covs: Float, color: str, zorder: float = 1.5) -> EllipseCollection:
    """Draw the 3-sigma ellipses of positions (n, 2) [m] with covariances (n, 2, 2)."""
    variances, directions = np.linalg.eigh(covs)
    short, long = 6 * np.sqrt(variances.clip(min=0)).T
    ellipses = EllipseCollection(
        long,
        short,
        np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1])),
        units="xy",
        offsets=centers,
        offset_transform=ax.transData,
        facecolors="none",
        edgecolors=color,
        linewidths=0.5,
        alpha=0.8,
        zorder=zorder,
    )
    ax.add_collection(ellipses, autolim=False)
    return ellipses


def draw_map(ax: Axes, rows: MapRows, color: str) -> None:
    """Draw points with their ellipses, and members of rays as ellipses that are darker if they are more likely."""
    points, members = rows.only(rows.member < 0), rows.only(rows.member >= 0)
    draw_ellipses(ax, points.position, points.cov, color)
    ax.plot(*points.position.T, color=color, zorder=3, **POINT)
    opacity = FAINTEST + (1 - FAINTEST) * members.weight
    drawn = draw_ellipses(ax, members.position, members.cov, color, zorder=1.2)
    drawn.set_alpha(None)  # it would replace the opacity of each member
    drawn.set(edgecolor=to_rgba_array(color, opacity), facecolor=to_rgba_array(color, FILLING * opacity))


class Scene:
    """A run at a step: paths of the `shown` estimates, robots and maps of the `mapped` ones.

    Attributes:
        low: lower left corner (2,) [m] of the axes, which contain the paths up to the step `last` and landmarks, and
            earlier maps as far as possible.
        high: upper right corner (2,) [m].
    """

    def __init__(
        self,
        results: Results,
        shown: Mapping[str, Estimate],
        mapped: Mapping[str, Estimate],
        last: int | None = None,
    ) -> None:
        """Find the limits, and the steps at which the landmarks of maps without a history appear."""
        self._truth, self._recording = results.truth or Truth(), results.recording
        self._shown, self._mapped = shown, mapped
        self._styles = styles(results.estimates)  # same styles as in the figure of the run
        finals = {name: each for name, each in mapped.items() if each.history is None}
        self._since = {name: first_seen(self._recording, each) for name, each in finals.items()}
        end = None if last is None else last + 1
        poses = [each.poses for each in (self._truth, *shown.values())]
        paths = [each[:end, :2] for each in poses if each is not None]
        known = self._truth.landmarks
        landmarks = [known] if known is not None else [each.landmarks for each in mapped.values()]
        passing = [each.history.position for each in mapped.values() if each.history is not None]
        self.low, self.high = map_limits([*paths, *landmarks], passing)

    def draw(self, ax: Axes, step: int, after: int = -1) -> None:
        """Draw a step on cleared axes, with lines of sight of the last scan after the step `after`.

        A map is that of the history, or else the final map of the landmarks that were observed so far.
        """
        ax.clear()
        ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        left, bottom = self.low
        right, top = self.high
        ax.set(xlim=(left, right), ylim=(bottom, top))
        draw_true_landmarks(ax, self._truth.landmarks)
        if self._truth.poses is not None:
            self._draw_robot(ax, self._truth.poses[: step + 1], TRUE_ROBOT, "truth")
        for name, each in self._shown.items():
            path, style = each.poses[: step + 1], self._styles[name]
            if name not in self._mapped:
                draw_path(ax, path[:, :2], style, name)
                continue
            self._draw_robot(ax, path, style, name)
            if each.pose_covs is not None:
                place, cov = path[-1:, :2], each.pose_covs[[step], :2, :2]
                draw_ellipses(ax, place, cov, style.color, zorder=2.5)
            if name in self._since:
                places = each.landmarks[self._since[name] <= step]
                ax.plot(*places.T, color=style.color, alpha=FAINT, zorder=2.8, **POINT)
            else:
                draw_map(ax, map_at(each, step), style.color)
        lines = sight_lines(self._recording, next(iter(self._mapped.values())), after, step)
        ax.add_collection(LineCollection([*lines], colors=MARK_COLOR, linewidths=0.4, zorder=1), autolim=False)
        ax.plot([], [], color=MARK_COLOR, linewidth=0.4, label="line of sight")
        explain(ax, ellipses=True)

    def _draw_robot(self, ax: Axes, poses: Float, style: Style, label: str) -> None:
        """Draw the path (n, 3) and the robot at its end; the true robot is an outline above the others."""
        draw_path(ax, poses[:, :2], style, label)
        size = ROBOT * (self.high - self.low).max()
        outline = poses[-1, :2] + size * SHAPE @ rotation(poses[-1, 2]).T
        face, zorder = ("none", 5) if style == TRUE_ROBOT else (style.color, 4)
        ax.add_patch(Polygon(outline, facecolor=face, edgecolor=style.color, linewidth=0.7, zorder=zorder))
