"""Planar landmark SLAM filters.

`textbook`: the EKF of the exercise, to be read first. `settings`: settings of filters. `kernels`: compiled steps.
`maps`: state and landmarks. `slam_filter` (ids are known), `associating_filter` (ids are unknown), `bearings`
(bearing-only) and `advanced`: the online filters. `estimators`: the filters as functions from a recording to an
estimate.

Names are imported on first use, so that settings load no compiler.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from slamgauge.ekf import estimators
    from slamgauge.ekf.advanced.compressed_filter import CompressedFilter
    from slamgauge.ekf.advanced.sliding_window import SlidingWindowFilter
    from slamgauge.ekf.associating_filter import AssociatingFilter
    from slamgauge.ekf.bearings.bearing_filter import BearingFilter
    from slamgauge.ekf.estimators import *
    from slamgauge.ekf.online_filter import OnlineFilter
    from slamgauge.ekf.settings.association import Association, MapManagement
    from slamgauge.ekf.settings.filter_settings import FilterSettings
    from slamgauge.ekf.settings.initialisation import Delayed, InverseDepth, Rays
    from slamgauge.ekf.settings.robustness import Robustness
    from slamgauge.ekf.slam_filter import SlamFilter
    from slamgauge.ekf.textbook import textbook_ekf

    __all__ = [
        "AssociatingFilter",
        "Association",
        "BearingFilter",
        "CompressedFilter",
        "Delayed",
        "FilterSettings",
        "InverseDepth",
        "MapManagement",
        "OnlineFilter",
        "Rays",
        "Robustness",
        "SlamFilter",
        "SlidingWindowFilter",
        "textbook_ekf",
    ]
    __all__ += estimators.__all__

_NAMES = {  # of each module, as above
    "textbook": "textbook_ekf",
    "associating_filter": "AssociatingFilter",
    "bearings.bearing_filter": "BearingFilter",
    "advanced.compressed_filter": "CompressedFilter",
    "slam_filter": "SlamFilter",
    "online_filter": "OnlineFilter",
    "settings.association": "Association MapManagement",
    "settings.filter_settings": "FilterSettings",
    "settings.initialisation": "Delayed InverseDepth Rays",
    "settings.robustness": "Robustness",
    "advanced.sliding_window": "SlidingWindowFilter",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(importlib.import_module(f"slamgauge.ekf.{_HOME[name]}"), name)
    if name == "__all__" or not name.startswith("_"):
        estimators = importlib.import_module("slamgauge.ekf.estimators")
        if name == "__all__":
            return sorted([*_HOME, *estimators.__all__])
        if name in estimators.__all__:
            return getattr(estimators, name)
    raise AttributeError(f"module 'slamgauge.ekf' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__getattr__("__all__"))  # pyright: ignore[reportArgumentType, reportUnknownVariableType]
