"""Draw outlines of 3-sigma ellipses, and move them from frame to frame."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection

from slamgauge.arrays import Float


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
