"""Compile every kernel once, because the workers of the tests would each compile them."""

from __future__ import annotations

from slamgauge.compare.cli.machine import compile_optima
from slamgauge.ekf.kernels import warm_up
from slamgauge.ekf.maps.correction_table import RULES


def compile_kernels() -> None:
    """Compile (or load) the kernels of all filters and of the optimum."""
    for rule in RULES.values():
        warm_up.compile_steps(rule.update, heavy_tails=True)
        warm_up.compile_map_edits(rule.retract)
        warm_up.compile_bearings(rule.retract)
    warm_up.compile_nearest_neighbour()
    warm_up.compile_joint_association()
    compile_optima()


if __name__ == "__main__":
    compile_kernels()
