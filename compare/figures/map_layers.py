"""Artists of maps: paths, 3-sigma ellipses, a robot with its path, and a map of points and rays that can move."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from slamgauge.arrays import Float
from slamgauge.compare.figures.axes import LONG
from slamgauge.compare.figures.map_contents import MapRows
from slamgauge.compare.figures.plot_style import MARK_COLOR, TRUTH_COLOR, Style
from slamgauge.se2 import rotation

SHAPE = np.array([[1.0, 0.0], [-0.7, 0.65], [-0.35, 0.0], [-0.7, -0.65]])  # outline of the robot; x points forward
FAINTEST = 0.2  # opacity of a member of weight 0
FILLING = 0.2  # opacity of the inside of a member, relative to its outline
NO_PLACES, NO_COVS = np.zeros((0, 2)), np.zeros((0, 2, 2))
POINT: dict[str, Any] = {"marker": ".", "markersize": 3, "linestyle": "none"}
OUTLINE: dict[str, Any] = {"marker": "o", "markersize": 6, "linestyle": "none", "markerfacecolor": "none"}
CROSS: dict[str, Any] = {"marker": "+", "markersize": 5, "linestyle": "none", "markeredgewidth": 0.8}
TRUE_ROBOT = Style(TRUTH_COLOR, "-")


def draw_path(ax: Axes, places: Float, style: Style, label: str) -> Line2D:
    """Draw the path through positions (n, 2) [m]."""
    look: dict[str, Any] = {"color": style.color, "linestyle": style.dashes, "linewidth": 1.0, "zorder": 2.5}
    return ax.plot(*places.T, label=label, rasterized=len(places) > LONG, **look)[0]


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
    ellipses = EllipseCollection(
        *_diameters_and_angles(covs),
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


def move_ellipses(ellipses: EllipseCollection, centers: Float, covs: Float) -> None:
    """Replace the ellipses by those of positions (n, 2) [m] with covariances (n, 2, 2), for any n."""
    widths, heights, angles = _diameters_and_angles(covs)
    ellipses.set(widths=widths, heights=heights, angles=angles, offsets=centers)


def _diameters_and_angles(covs: Float) -> tuple[Float, Float, Float]:
    """Return long and short diameters (n,) [m], and the angles of the long ones [deg]."""
    variances, directions = np.linalg.eigh(covs)
    short, long = 6 * np.sqrt(variances.clip(min=0)).T
    return long, short, np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))


class MapLayer:
    """Map of one estimate: dots and 3-sigma ellipses; members of rays are darker if they are more likely."""

    def __init__(self, ax: Axes, color: str) -> None:
        """Create empty artists."""
        self._color = to_rgb(color)
        self._points = draw_ellipses(ax, NO_PLACES, NO_COVS, color)
        (self._dots,) = ax.plot([], [], color=color, zorder=3, **POINT)
        self._members = draw_ellipses(ax, NO_PLACES, NO_COVS, color, zorder=1.2)
        self._members.set_alpha(None)  # opacity is set per member

    def show(self, rows: MapRows) -> None:
        """Show these points and members."""
        points, members = rows.only(rows.member < 0), rows.only(rows.member >= 0)
        move_ellipses(self._points, points.position, points.cov)
        self._dots.set_data(*points.position.T)
        move_ellipses(self._members, members.position, members.cov)
        opacity = FAINTEST + (1 - FAINTEST) * members.weight
        self._members.set_edgecolor([(*self._color, each) for each in opacity])
        self._members.set_facecolor([(*self._color, FILLING * each) for each in opacity])


class RobotLayer:
    """Robot at its pose, the path so far, and the 3-sigma ellipse of the position."""

    def __init__(self, ax: Axes, style: Style, size: float, label: str) -> None:
        """Create empty artists; `size` [m] is the distance from the centre of the robot to its front."""
        self._size = size
        self._path = draw_path(ax, NO_PLACES, style, label)
        face = "none" if style == TRUE_ROBOT else style.color  # the true robot is an outline above the others
        zorder = 5 if style == TRUE_ROBOT else 4
        self._body = Polygon(size * SHAPE, facecolor=face, edgecolor=style.color, linewidth=0.7, zorder=zorder)
        ax.add_patch(self._body)
        self._ellipse = draw_ellipses(ax, NO_PLACES, NO_COVS, style.color, zorder=2.5)

    def show(self, poses: Float, cov: Float | None = None) -> None:
        """Show the poses so far (k+1, 3), and the covariance (3, 3) of the last one if given."""
        self._path.set_data(*poses[:, :2].T)
        self._body.set_xy(poses[-1, :2] + self._size * SHAPE @ rotation(poses[-1, 2]).T)
        if cov is not None:
            move_ellipses(self._ellipse, poses[-1:, :2], cov[None, :2, :2])
