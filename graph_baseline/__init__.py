"""The optimum that the measurements allow, causal and in hindsight; which module is what tells README.md."""

from pathlib import Path

from slamgauge.compiled import drop_outdated
from slamgauge.graph_baseline.causal import isam2
from slamgauge.graph_baseline.hindsight import batch
from slamgauge.graph_baseline.linearisation import cost
from slamgauge.graph_baseline.robust import robust_batch
from slamgauge.graph_baseline.undetermined import UndeterminedError

__all__ = ["UndeterminedError", "batch", "cost", "isam2", "robust_batch"]

drop_outdated(Path(__file__).parent)  # numba looks at what is kept when a kernel is first called
