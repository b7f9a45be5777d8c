"""The optimum that the measurements allow, causal and in hindsight; which module is what tells README.md."""

from slamgauge.graph_baseline.bound import causal_bound, hindsight_bound
from slamgauge.graph_baseline.causal import causal
from slamgauge.graph_baseline.fixed_lag import fixed_lag
from slamgauge.graph_baseline.hindsight import batch
from slamgauge.graph_baseline.problem.linearisation import cost
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError
from slamgauge.graph_baseline.robust import robust_batch

__all__ = [
    "UndeterminedError",
    "batch",
    "causal",
    "causal_bound",
    "cost",
    "fixed_lag",
    "hindsight_bound",
    "robust_batch",
]
