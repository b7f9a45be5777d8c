"""Planar landmark SLAM filters.

`models` (sensors), `workspace` (arrays), `kernels` (the steps, compiled), `corrections` (what tells the filters apart),
`filter` (the online form), `compressed` (the same for large maps), `estimators` (recording in, estimate out).

Without ids: `association` (the online form), `one_by_one` (nearest neighbour), `compatibility` (joint association),
`map_management` (probation, deletion, merging), `map_edits` (what these do to the state). Bearings alone: `rays`.
"""

from ekf.association import AssociatingFilter, Association
from ekf.compressed import CompressedFilter
from ekf.estimators import dead_reckoning, ekf, fej_ekf, iekf, riekf
from ekf.filter import SlamFilter
from ekf.map_management import MapManagement
from ekf.rays import RayFilter, Rays

__all__ = [
    "AssociatingFilter",
    "Association",
    "CompressedFilter",
    "MapManagement",
    "RayFilter",
    "Rays",
    "SlamFilter",
    "dead_reckoning",
    "ekf",
    "fej_ekf",
    "iekf",
    "riekf",
]
