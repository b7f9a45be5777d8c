"""Planar landmark SLAM filters; README.md lists the modules.

Names are imported on first use, so that settings load no compiler.
"""

from slamgauge import homes_of, importer

TYPE_CHECKING = False
if TYPE_CHECKING:
    from slamgauge.ekf.associating_filter import AssociatingFilter as AssociatingFilter
    from slamgauge.ekf.bearings.bearing_filter import BearingFilter as BearingFilter
    from slamgauge.ekf.estimators import (
        dead_reckoning as dead_reckoning,
        ekf_slam as ekf_slam,
        fej_ekf as fej_ekf,
        iekf as iekf,
        oc_ekf as oc_ekf,
        riekf as riekf,
    )
    from slamgauge.ekf.online_filter import OnlineFilter as OnlineFilter
    from slamgauge.ekf.settings import (
        Association as Association,
        Delayed as Delayed,
        FilterSettings as FilterSettings,
        MapManagement as MapManagement,
        Rays as Rays,
        Robustness as Robustness,
    )
    from slamgauge.ekf.slam_filter import SlamFilter as SlamFilter
    from slamgauge.ekf.textbook import textbook_ekf as textbook_ekf

_HOMES = homes_of(__loader__.get_data(__file__))
__getattr__ = importer(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted(_HOMES)
