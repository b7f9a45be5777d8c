"""Is your EKF-SLAM overconfident, and how much accuracy does it lose?

The public names of all packages, imported on first use, so that `import slamgauge` loads no library. The packages are
`slamgauge.ekf`, `slamgauge.graph_baseline` and `slamgauge.compare`; no public name is both a package and a function
(the estimator called `ekf` is the function `ekf_slam`).

If numpy is not imported yet, the import limits BLAS to one thread, unless the environment sets a number.
"""

import sys
from _ast import If, ImportFrom, Module, PyCF_ONLY_AST  # built in: a user's file `ast.py` does not replace it
from collections.abc import Callable
from importlib import import_module

from slamgauge.blas_threads import pin_blas_threads

TYPE_CHECKING = False  # `typing` is not imported: `python -m slamgauge` might find a user's file of that name first
if TYPE_CHECKING:
    from slamgauge.arrays import Float as Float, Int as Int, Marks as Marks
    from slamgauge.compare.checks.examination import Verdict as Verdict, check_estimator as check_estimator
    from slamgauge.compare.estimators import adapters as adapters
    from slamgauge.compare.estimators.loading import load_estimators as load_estimators
    from slamgauge.compare.figures.publishing import write_study as write_study
    from slamgauge.compare.figures.run_figures import (
        plot_errors as plot_errors,
        plot_run as plot_run,
        save_figure as save_figure,
    )
    from slamgauge.compare.noise.estimation import Noise as Noise, find_noise as find_noise
    from slamgauge.compare.scenarios.scenario import (
        Scenario as Scenario,
        load_scenario as load_scenario,
        shipped_scenarios as shipped_scenarios,
    )
    from slamgauge.compare.scenarios.simulation import informed as informed, simulate as simulate
    from slamgauge.compare.scoring.comparison import Comparison as Comparison, compare_estimators as compare_estimators
    from slamgauge.compare.scoring.error_bounds import assert_error_bounds as assert_error_bounds
    from slamgauge.compare.scoring.scores import Score as Score, evaluate as evaluate
    from slamgauge.compare.storage.files import (
        load_estimate as load_estimate,
        load_recording as load_recording,
        load_truth as load_truth,
        save as save,
    )
    from slamgauge.compare.studies.baseline import assert_not_worse as assert_not_worse
    from slamgauge.compare.studies.budget import ErrorBudget as ErrorBudget, error_budget as error_budget
    from slamgauge.compare.studies.executors import dask_cluster as dask_cluster, local_processes as local_processes
    from slamgauge.compare.studies.study import load_runs as load_runs, run_study as run_study
    from slamgauge.compare.studies.summary import Summary as Summary
    from slamgauge.compare.studies.sweep import run_sweep as run_sweep
    from slamgauge.ekf import (
        AssociatingFilter as AssociatingFilter,
        Association as Association,
        BearingFilter as BearingFilter,
        Delayed as Delayed,
        MapManagement as MapManagement,
        OnlineFilter as OnlineFilter,
        Rays as Rays,
        Robustness as Robustness,
        SlamFilter as SlamFilter,
        dead_reckoning as dead_reckoning,
        ekf_slam as ekf_slam,
        fej_ekf as fej_ekf,
        iekf as iekf,
        oc_ekf as oc_ekf,
        riekf as riekf,
        textbook_ekf as textbook_ekf,
    )
    from slamgauge.errors import UserError as UserError
    from slamgauge.estimate import (
        Estimate as Estimate,
        Estimator as Estimator,
        Kind as Kind,
        MapHistory as MapHistory,
        RayLog as RayLog,
    )
    from slamgauge.graph_baseline import (
        UndeterminedError as UndeterminedError,
        batch as batch,
        causal as causal,
        causal_bound as causal_bound,
        cost as cost,
        fixed_lag as fixed_lag,
        gtsam_batch as gtsam_batch,
        hindsight_bound as hindsight_bound,
        isam2 as isam2,
        robust_batch as robust_batch,
    )
    from slamgauge.recording import Observations as Observations, Recording as Recording
    from slamgauge.se2 import between as between, chain as chain, compose as compose, rotation as rotation, wrap as wrap
    from slamgauge.sensors import OBSERVATION_DIM as OBSERVATION_DIM, Sensor as Sensor
    from slamgauge.triangulation import Triangulation as Triangulation, triangulate as triangulate
    from slamgauge.truth import Truth as Truth
    from slamgauge.version import __version__ as __version__


def homes_of(source: bytes) -> dict[str, str]:
    """Return the module of each name that the first `if` statement of a source imports.

    A package lists its public names once, in the `if TYPE_CHECKING:` block of its `__init__`.
    """
    module = compile(source, "__init__.py", "exec", PyCF_ONLY_AST)
    assert isinstance(module, Module)
    block = next(node for node in module.body if isinstance(node, If))
    imports = [node for node in block.body if isinstance(node, ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


def importer(package: str, homes: dict[str, str], *modules: str) -> Callable[[str], object]:
    """Return the `__getattr__` of a package: names from their homes, and these modules of the package."""

    def getter(name: str) -> object:
        if name in homes:
            return getattr(__import__(homes[name], fromlist=[name]), name)  # also if `name` is a module
        if name in modules:
            return import_module(f"{package}.{name}")
        if name == "__all__":
            return sorted(homes)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return getter


_PACKAGES = ("compare", "ekf", "graph_baseline")
_HOMES = homes_of(__loader__.get_data(__file__))
_MODULES = [home.removeprefix("slamgauge.") for home in _HOMES.values() if home.count(".") == 1]
__getattr__ = importer(__name__, _HOMES, *_PACKAGES, *_MODULES, "suggestions", "validation")

if "numpy" not in sys.modules:  # later the number has no effect
    pin_blas_threads()


def __dir__() -> list[str]:
    return sorted([*_HOMES, *_PACKAGES])
