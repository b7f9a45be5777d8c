"""Scenarios, scores and figures: filters held against their optimum on the same measurements.

The names below are imported when they are first used, so that `import compare` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compare.assertions import assert_error_bounds
    from compare.budget import ErrorBudget, error_budget
    from compare.claims import judge_claims
    from compare.comparison import Comparison, compare_estimators
    from compare.error_panels import plot_errors
    from compare.estimators import load_estimators
    from compare.executors import dask_cluster, local_processes
    from compare.files import load_estimate, load_recording, load_truth, save
    from compare.plots import plot_run, save_figure
    from compare.scenario import Scenario, load_scenario, shipped_scenarios
    from compare.scores import Score, evaluate
    from compare.simulation import informed, simulate
    from compare.study import load_runs, run_study, write_study
    from compare.study_summary import Summary
    from compare.sweep import run_sweep

_HOME = {
    "Comparison": "comparison",
    "ErrorBudget": "budget",
    "Scenario": "scenario",
    "Score": "scores",
    "Summary": "study_summary",
    "assert_error_bounds": "assertions",
    "compare_estimators": "comparison",
    "dask_cluster": "executors",
    "error_budget": "budget",
    "evaluate": "scores",
    "informed": "simulation",
    "judge_claims": "claims",
    "load_estimate": "files",
    "load_estimators": "estimators",
    "load_recording": "files",
    "load_runs": "study",
    "load_scenario": "scenario",
    "load_truth": "files",
    "local_processes": "executors",
    "plot_errors": "error_panels",
    "plot_run": "plots",
    "run_study": "study",
    "run_sweep": "sweep",
    "save": "files",
    "save_figure": "plots",
    "shipped_scenarios": "scenario",
    "simulate": "simulation",
    "write_study": "study",
}

__all__ = [
    "Comparison",
    "ErrorBudget",
    "Scenario",
    "Score",
    "Summary",
    "assert_error_bounds",
    "compare_estimators",
    "dask_cluster",
    "error_budget",
    "evaluate",
    "informed",
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
    "run_study",
    "run_sweep",
    "save",
    "save_figure",
    "shipped_scenarios",
    "simulate",
    "write_study",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'compare' has no attribute {name!r}")
    return getattr(importlib.import_module(f"compare.{_HOME[name]}"), name)
