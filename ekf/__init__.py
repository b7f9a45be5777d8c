"""Planar landmark SLAM filters.

`settings` what people choose; `kernels` the steps, compiled; `maps` the belief and its book-keeping, and the table of
corrections; `bearings` landmarks from bearings alone; `window` the parts of `window_filter`, whose last steps are
linearised anew. Here are the online filters, `filter` (with ids), `association` (without), `compressed` (the same for
large maps), and `estimators`: a recording in, an estimate out.

Names are imported when they are first used, so that a setting costs no compiler. The filters as estimators are those
that `estimators` lists.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from slamgauge.ekf import estimators
    from slamgauge.ekf.associating_filter import AssociatingFilter
    from slamgauge.ekf.bearings.bearing_filter import BearingFilter
    from slamgauge.ekf.advanced.compressed_filter import CompressedFilter
    from slamgauge.ekf.estimators import *
    from slamgauge.ekf.slam_filter import SlamFilter
    from slamgauge.ekf.online_filter import OnlineFilter
    from slamgauge.ekf.settings.association import Association, MapManagement
    from slamgauge.ekf.settings.initialisation import Delayed, InverseDepth, Rays
    from slamgauge.ekf.settings.robustness import Robustness
    from slamgauge.ekf.advanced.sliding_window import SlidingWindowFilter

    __all__ = [
        "AssociatingFilter",
        "Association",
        "BearingFilter",
        "CompressedFilter",
        "Delayed",
        "InverseDepth",
        "MapManagement",
        "OnlineFilter",
        "Rays",
        "Robustness",
        "SlamFilter",
        "SlidingWindowFilter",
    ]
    __all__ += estimators.__all__

_NAMES = {  # of each module, as above
    "association": "AssociatingFilter",
    "bearings.bearing_filter": "BearingFilter",
    "compressed": "CompressedFilter",
    "filter": "SlamFilter",
    "online": "OnlineFilter",
    "settings.association": "Association MapManagement",
    "settings.initialisation": "Delayed InverseDepth Rays",
    "settings.robustness": "Robustness",
    "window_filter": "SlidingWindowFilter",
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
