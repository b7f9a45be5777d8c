"""Planar landmark SLAM filters.

`models` (sensors), `workspace` (arrays), `kernels` (the steps, compiled), `corrections` (what tells the filters apart),
`filter` (the online form), `compressed` (the same for large maps), `estimators` (recording in, estimate out).

Without ids: `association` (the online form), `one_by_one` (nearest neighbour), `compatibility` (joint association),
`map_management` (probation, deletion, merging), `map_edits` (what these do to the state).

Bearings alone: `bearing_only` (the online form); landmarks begin as `rays`, in `inverse_depth` or `delayed` (`young`:
what these have in common, `linear`: measurements with Jacobians of their own); `ray_association` without ids.
"""

from slamgauge.ekf.association import AssociatingFilter
from slamgauge.ekf.bearings.bearing_filter import BearingFilter
from slamgauge.ekf.compressed import CompressedFilter
from slamgauge.ekf.estimators import dead_reckoning, ekf, fej_ekf, iekf, riekf
from slamgauge.ekf.filter import SlamFilter
from slamgauge.ekf.settings.association import Association, MapManagement
from slamgauge.ekf.settings.initialisation import Delayed, InverseDepth, Rays

__all__ = [
    "AssociatingFilter",
    "Association",
    "BearingFilter",
    "CompressedFilter",
    "Delayed",
    "InverseDepth",
    "MapManagement",
    "Rays",
    "SlamFilter",
    "dead_reckoning",
    "ekf",
    "fej_ekf",
    "iekf",
    "riekf",
]
