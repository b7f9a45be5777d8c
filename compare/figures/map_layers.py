"""Moving artists: 3-sigma ellipses, a robot with its path, and a map of points and rays."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from slamgauge.arrays import Float
from slamgauge.compare.figures.map_contents import MapRows
from slamgauge.compare.figures.plot_style import TRUTH_COLOR, Style
from slamgauge.se2 import rotation

SHAPE = np.array([[1.0, 0.0], [-0.7, 0.65], [-0.35, 0.0], [-0.7, -0.65]])  # outline of the robot; x points forward
FAINTEST = 0.2  # opacity of a member of weight 0
FILLING = 0.2  # opacity of the inside of a member, relative to its outline
NO_PLACES, NO_COVS = np.zeros((0, 2)), np.zeros((0, 2, 2))
POINT: dict[str, Any] = {"marker": ".", "markersize": 3.5, "linestyle": "none"}
HEAVIEST: dict[str, Any] = {"marker": "D", "markersize": 2.8, "linestyle": "none", "markeredgewidth": 0}
MEMBER: dict[str, Any] = {"marker": "o", "markersize": 6, "linestyle": "none", "markerfacecolor": "none"}
TRUE_LANDMARK: dict[str, Any] = {
    "marker": "+",
    "markersize": 5,
    "linestyle": "none",
    "color": TRUTH_COLOR,
    "markeredgewidth": 0.8,
    "zorder": 3,
}
TRUE_ROBOT = Style(TRUTH_COLOR, "-")


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
    ellipses.set_widths(widths)
    ellipses.set_heights(heights)
    ellipses.set_angles(angles)
    ellipses.set_offsets(centers)


def _diameters_and_angles(covs: Float) -> tuple[Float, Float, Float]:
    """Return long and short diameters (n,) [m], and the angles of the long ones [deg]."""
    variances, directions = np.linalg.eigh(covs)
    short, long = 6 * np.sqrt(variances.clip(min=0)).T
    return long, short, np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))


class MapLayer:
    """Map of one estimate: dots and 3-sigma ellipses; members of rays are darker if they are more likely."""

    def __init__(self, ax: Axes, color: str, *, filled: bool = True) -> None:
        """Create empty artists; members are outlines unless `filled`, because colours of several maps would mix."""
        self._filling = FILLING if filled else 0.0
        self._color = to_rgb(color)
        self._points = draw_ellipses(ax, NO_PLACES, NO_COVS, color)
        (self._dots,) = ax.plot([], [], color=color, zorder=3, **POINT)
        self._members = draw_ellipses(ax, NO_PLACES, NO_COVS, color, zorder=1.2)
        self._members.set_alpha(None)  # opacity is set per member
        (self._heaviest,) = ax.plot([], [], color=color, zorder=3, **HEAVIEST)

    def show(self, rows: MapRows) -> None:
        """Show these points and members."""
        points, members = rows.only(rows.member < 0), rows.only(rows.member >= 0)
        move_ellipses(self._points, points.position, points.cov)
        self._dots.set_data(*points.position.T)
        move_ellipses(self._members, members.position, members.cov)
        opacity = FAINTEST + (1 - FAINTEST) * members.weight
        self._members.set_edgecolor([(*self._color, each) for each in opacity])
        self._members.set_facecolor([(*self._color, self._filling * each) for each in opacity])
        self._heaviest.set_data(*members.position[members.heaviest()].T)


class RobotLayer:
    """Robot at its pose, the path so far, and the 3-sigma ellipse of the position."""

    def __init__(self, ax: Axes, style: Style, size: float, *, filled: bool = True) -> None:
        """Create empty artists; `size` [m] is the distance from the centre of the robot to its front.

        A robot that is not `filled` is drawn as an outline above the others.
        """
        self._size = size
        self._path = draw_path(ax, style)
        solid: dict[str, Any] = {"facecolor": style.color, "edgecolor": "w", "linewidth": 0.3, "zorder": 4}
        outline: dict[str, Any] = {"facecolor": "none", "edgecolor": style.color, "linewidth": 0.7, "zorder": 5}
        self._body = Polygon(size * SHAPE, visible=False, **(solid if filled else outline))
        ax.add_patch(self._body)
        self._ellipse = draw_ellipses(ax, NO_PLACES, NO_COVS, style.color, zorder=2.5)

    def show(self, poses: Float, cov: Float | None = None) -> None:
        """Show the poses so far (k+1, 3), and the covariance (3, 3) of the last one if given."""
        self._path.set_data(*poses[:, :2].T)
        self._body.set_visible(True)
        self._body.set_xy(poses[-1, :2] + self._size * SHAPE @ rotation(poses[-1, 2]).T)
        if cov is not None:
            move_ellipses(self._ellipse, poses[-1:, :2], cov[None, :2, :2])


def draw_path(ax: Axes, style: Style) -> Line2D:
    """Return a new path without positions."""
    return ax.plot([], [], color=style.color, linestyle=style.dashes, linewidth=1.0, zorder=2.5)[0]


def key(label: str, **look: Any) -> Line2D:
    """Return a legend entry."""
    return Line2D([], [], label=label, **look)
