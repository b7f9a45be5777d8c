"""Factor-graph estimators: GTSAM's solvers and the exact optima; README.md lists the modules."""

from slamgauge.graph_baseline.bound import causal_bound, hindsight_bound
from slamgauge.graph_baseline.causal import causal
from slamgauge.graph_baseline.hindsight import batch
from slamgauge.graph_baseline.problem.objective import cost
from slamgauge.graph_baseline.problem.undetermined import UndeterminedError, unavailable
from slamgauge.graph_baseline.robust import robust_batch

try:
    from slamgauge.graph_baseline.gtsam_batch import gtsam_batch
    from slamgauge.graph_baseline.gtsam_fixed_lag import fixed_lag
    from slamgauge.graph_baseline.gtsam_isam2 import isam2
except ImportError as error:  # GTSAM has no wheels for Windows
    gtsam_batch = unavailable("gtsam_batch", "batch", error)
    fixed_lag = unavailable("fixed_lag", "causal", error)
    isam2 = unavailable("isam2", "causal", error)

__all__ = [
    "UndeterminedError",
    "batch",
    "causal",
    "causal_bound",
    "cost",
    "fixed_lag",
    "gtsam_batch",
    "hindsight_bound",
    "isam2",
    "robust_batch",
]
