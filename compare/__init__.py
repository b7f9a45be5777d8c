"""Scenarios, scores and figures: filters held against their optimum on the same measurements.

The names below are imported when they are first used, so that `import compare` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from compare.assertions import assert_error_bounds
    from compare.comparison import Comparison, compare_estimators
    from compare.error_panels import plot_errors
    from compare.estimators import load_estimators
    from compare.files import load_estimate, load_recording, load_truth, save
    from compare.plots import plot_run, save_figure
    from compare.scenario import Scenario, load_scenario, shipped_scenarios
    from compare.scores import Score, evaluate
    from compare.simulation import simulate

_HOME = {
    "Comparison": "comparison",
    "Scenario": "scenario",
    "Score": "scores",
    "assert_error_bounds": "assertions",
    "compare_estimators": "comparison",
    "evaluate": "scores",
    "load_estimate": "files",
    "load_estimators": "estimators",
    "load_recording": "files",
    "load_scenario": "scenario",
    "load_truth": "files",
    "plot_errors": "error_panels",
    "plot_run": "plots",
    "save": "files",
    "save_figure": "plots",
    "shipped_scenarios": "scenario",
    "simulate": "simulation",
}

__all__ = [
    "Comparison",
    "Scenario",
    "Score",
    "assert_error_bounds",
    "compare_estimators",
    "evaluate",
    "load_estimate",
    "load_estimators",
    "load_recording",
    "load_scenario",
    "load_truth",
    "plot_errors",
    "plot_run",
    "save",
    "save_figure",
    "shipped_scenarios",
    "simulate",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'compare' has no attribute {name!r}")
    return getattr(importlib.import_module(f"compare.{_HOME[name]}"), name)
