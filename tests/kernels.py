"""Compile every kernel once, because the workers of the tests would each compile them."""

from __future__ import annotations

from slamgauge.ekf.advanced.window.warm_up import compile_window_once
from slamgauge.ekf.kernels.warm_up import (
    compile_association_once,
    compile_bearings_once,
    compile_numpy_filters_once,
    compile_once,
)
from slamgauge.graph_baseline.solver.warm_up import compile_graphs_once

if __name__ == "__main__":
    compile_once()
    compile_association_once()
    compile_bearings_once()
    compile_numpy_filters_once()
    compile_window_once()
    compile_graphs_once()
