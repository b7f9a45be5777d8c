"""How far is your SLAM filter from the best that its measurements allow?

The public names of all packages, imported when they are first used, so that `import slamgauge` costs nothing. The
packages themselves are `slamgauge.ekf`, `slamgauge.graph_baseline` and `slamgauge.compare`; no public name is a package
and a function at once (the estimator called `ekf` is the function `ekf_slam`).
"""

import importlib

from slamgauge.version import __version__

TYPE_CHECKING = False  # as in `typing`, which is not loaded: `python -m slamgauge` might find a file of that name first
if TYPE_CHECKING:
    from slamgauge.arrays import Float, Int, Marks
    from slamgauge.compare.checks.examination import Verdict, check_estimator
    from slamgauge.compare.estimators import adapters
    from slamgauge.compare.estimators.loading import load_estimators
    from slamgauge.compare.figures.error_panels import plot_errors
    from slamgauge.compare.figures.publishing import write_study
    from slamgauge.compare.figures.run_figures import plot_run, save_figure
    from slamgauge.compare.noise.estimation import Noise, find_noise
    from slamgauge.compare.scenarios.scenario import Scenario, load_scenario, shipped_scenarios
    from slamgauge.compare.scenarios.simulation import informed, simulate
    from slamgauge.compare.scoring.assertions import assert_error_bounds
    from slamgauge.compare.scoring.comparison import Comparison, compare_estimators
    from slamgauge.compare.scoring.scores import Score, evaluate
    from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth, save
    from slamgauge.compare.studies.budget import ErrorBudget, error_budget
    from slamgauge.compare.studies.claims import judge_claims
    from slamgauge.compare.studies.executors import dask_cluster, local_processes
    from slamgauge.compare.studies.stopping_rule import Until
    from slamgauge.compare.studies.study import load_runs, run_study
    from slamgauge.compare.studies.summary import Summary
    from slamgauge.compare.studies.sweep import run_sweep
    from slamgauge.ekf import (
        AssociatingFilter,
        Association,
        BearingFilter,
        CompressedFilter,
        Delayed,
        InverseDepth,
        MapManagement,
        OnlineFilter,
        Rays,
        Robustness,
        SlamFilter,
        SlidingWindowFilter,
        estimators,
        textbook_ekf,
    )
    from slamgauge.ekf.estimators import *
    from slamgauge.errors import UserError
    from slamgauge.estimate import Estimate, Estimator, Kind, MapHistory, RayLog
    from slamgauge.graph_baseline import (
        UndeterminedError,
        batch,
        causal,
        causal_bound,
        cost,
        fixed_lag,
        gtsam_batch,
        hindsight_bound,
        isam2,
        robust_batch,
    )
    from slamgauge.recording import Observations, Recording
    from slamgauge.se2 import between, chain, compose, rotation, wrap
    from slamgauge.sensors import OBSERVATION_DIM, Sensor
    from slamgauge.triangulation import Triangulation, triangulate
    from slamgauge.truth import Truth

    __all__ = [
        "OBSERVATION_DIM",
        "AssociatingFilter",
        "Association",
        "BearingFilter",
        "Comparison",
        "CompressedFilter",
        "Delayed",
        "ErrorBudget",
        "Estimate",
        "Estimator",
        "Float",
        "Int",
        "InverseDepth",
        "Kind",
        "MapHistory",
        "MapManagement",
        "Marks",
        "Noise",
        "Observations",
        "OnlineFilter",
        "RayLog",
        "Rays",
        "Recording",
        "Robustness",
        "Scenario",
        "Score",
        "Sensor",
        "SlamFilter",
        "SlidingWindowFilter",
        "Summary",
        "Triangulation",
        "Truth",
        "UndeterminedError",
        "Until",
        "UserError",
        "Verdict",
        "__version__",
        "adapters",
        "assert_error_bounds",
        "batch",
        "between",
        "causal",
        "causal_bound",
        "chain",
        "check_estimator",
        "compare_estimators",
        "compose",
        "cost",
        "dask_cluster",
        "error_budget",
        "evaluate",
        "find_noise",
        "fixed_lag",
        "gtsam_batch",
        "hindsight_bound",
        "informed",
        "isam2",
        "judge_claims",
        "load_estimate",
        "load_estimators",
        "load_recording",
        "load_runs",
        "load_scenario",
        "load_truth",
        "local_processes",
        "plot_errors",
        "plot_run",
        "robust_batch",
        "rotation",
        "run_study",
        "run_sweep",
        "save",
        "save_figure",
        "shipped_scenarios",
        "simulate",
        "textbook_ekf",
        "triangulate",
        "wrap",
        "write_study",
    ]
    __all__ += estimators.__all__

_NAMES = {  # of each module, as above; a test holds the two lists together
    "arrays": "Float Int Marks",
    "errors": "UserError",
    "se2": "between chain compose rotation wrap",
    "sensors": "OBSERVATION_DIM Sensor",
    "recording": "Observations Recording",
    "truth": "Truth",
    "estimate": "Estimate Estimator Kind MapHistory RayLog",
    "triangulation": "Triangulation triangulate",
    "ekf": (
        "AssociatingFilter Association BearingFilter CompressedFilter Delayed InverseDepth MapManagement Rays "
        "OnlineFilter Robustness SlamFilter SlidingWindowFilter textbook_ekf"
    ),
    "graph_baseline": (
        "UndeterminedError batch causal causal_bound cost fixed_lag gtsam_batch hindsight_bound isam2 robust_batch"
    ),
    "compare.checks.examination": "Verdict check_estimator",
    "compare.scoring.comparison": "Comparison compare_estimators",
    "compare.studies.budget": "ErrorBudget error_budget",
    "compare.noise.estimation": "Noise find_noise",
    "compare.scenarios.scenario": "Scenario load_scenario shipped_scenarios",
    "compare.scoring.scores": "Score evaluate",
    "compare.studies.summary": "Summary",
    "compare.scoring.assertions": "assert_error_bounds",
    "compare.studies.executors": "dask_cluster local_processes",
    "compare.scenarios.simulation": "informed simulate",
    "compare.studies.claims": "judge_claims",
    "compare.storage.files": "load_estimate load_recording load_truth save",
    "compare.estimators": "adapters",
    "compare.estimators.loading": "load_estimators",
    "compare.studies.stopping_rule": "Until",
    "compare.studies.study": "load_runs run_study",
    "compare.figures.publishing": "write_study",
    "compare.figures.error_panels": "plot_errors",
    "compare.figures.run_figures": "plot_run save_figure",
    "compare.studies.sweep": "run_sweep",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
_PACKAGES = ("compare", "ekf", "graph_baseline")
_VOCABULARY = {module for module in _NAMES if "." not in module} | {"sensors", "suggestions", "validation"}


def __getattr__(name: str) -> object:
    if name in _PACKAGES:
        return importlib.import_module(f"slamgauge.{name}")
    if name in _HOME:  # as `from HOME import name`, whatever in HOME it names, a module too
        return getattr(__import__(f"slamgauge.{_HOME[name]}", fromlist=[name]), name)
    if name == "__all__":
        return sorted([*_HOME, *_filters(), "__version__"])
    if name in _VOCABULARY:
        return importlib.import_module(f"slamgauge.{name}")
    if not name.startswith("_") and name in _filters():
        return getattr(importlib.import_module("slamgauge.ekf.estimators"), name)
    raise AttributeError(f"module 'slamgauge' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_HOME, *_PACKAGES, *_filters(), "__version__"])


def names_of(package: str) -> list[str]:
    """Public names defined in a package, sorted."""
    return sorted(name for name, module in _HOME.items() if module.partition(".")[0] == package)


def _filters() -> list[str]:
    """Names of the filters as estimators."""
    return list(importlib.import_module("slamgauge.ekf.estimators").__all__)
