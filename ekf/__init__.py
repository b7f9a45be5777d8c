"""Planar landmark SLAM filters.

`models` (sensors), `workspace` (arrays), `kernels` (the steps, compiled), `corrections` (what tells the filters apart),
`filter` (the online form), `compressed` (the same for large maps), `estimators` (recording in, estimate out).
"""

from ekf.compressed import CompressedFilter
from ekf.estimators import dead_reckoning, ekf, fej_ekf, iekf, riekf
from ekf.filter import SlamFilter

__all__ = ["CompressedFilter", "SlamFilter", "dead_reckoning", "ekf", "fej_ekf", "iekf", "riekf"]
