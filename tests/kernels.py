"""Compile every kernel once, because the workers of the tests would each compile them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from slamgauge import batch, causal, load_scenario, simulate
from slamgauge.ekf import Association, Delayed, FilterSettings, MapManagement, Robustness, ekf_slam, iekf, riekf

JOINT = Association("jcbb", map_management=MapManagement())


@cache
def compile_kernels() -> None:
    """Compile (or load) the kernels of all filters and of the optimum by runs of two seconds."""
    ranges, bearings = (
        simulate(load_scenario(name, ["trajectory.duration=2"]), 0)[1] for name in ("q1-short-dense", "q4-ring")
    )
    for estimator in (ekf_slam, iekf, riekf):
        estimator(ranges, FilterSettings(robust=Robustness("student-t")))
        for association in (Association(), JOINT):
            estimator(replace(ranges, landmark=None), FilterSettings(association))
        for settings in (FilterSettings(), FilterSettings(initialisation=Delayed())):
            estimator(bearings, settings)
    for recording in (ranges, bearings):
        causal(recording)
        batch(recording)


if __name__ == "__main__":
    compile_kernels()
