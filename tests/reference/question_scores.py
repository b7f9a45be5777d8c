"""Cached scores of many runs of a question's scenario, with the start drawn from the prior."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from slamgauge import Scenario, Score, evaluate, load_estimators, load_scenario, simulate
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.estimate import Estimate


class Expected(NamedTuple):
    """Bounds on mean ATE and mean ratio; mean and standard deviation over runs of the map size."""

    ate_m: float
    ratio: float
    mapped: tuple[float, float]


@cache
def scores(name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...] = ()) -> dict[str, list[Score]]:
    """Return scores of `runs` runs (seeds 0, 1, ...) of each filter against the truth."""
    return _scores(name, filters, runs, overrides, graded=False)


@cache
def graded_scores(
    name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...] = ()
) -> dict[str, list[Score]]:
    """Return the same scores with the causal optimum, which has the true noise and associations."""
    return _scores(name, filters, runs, overrides, graded=True)


def _scores(
    name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...], *, graded: bool
) -> dict[str, list[Score]]:
    scenario = load_scenario(name, ["start=sampled", *overrides])
    estimators = load_estimators(
        filters, association=scenario.association, initialisation=scenario.initialisation_settings
    )
    true_noise = informed(scenario).model_dump_json()
    found: dict[str, list[Score]] = {each: [] for each in filters}
    for seed in range(runs):
        truth, recording = simulate(scenario, seed)
        optimum = causal_optimum(true_noise, seed) if graded else None
        for each, estimator in estimators.items():
            found[each].append(evaluate(truth, recording, estimator(recording), optimum))
    return found


@cache
def causal_optimum(scenario: str, seed: int) -> Estimate:
    """Return the estimate of `causal` on a run of the scenario given as JSON."""
    recording = simulate(Scenario.model_validate_json(scenario), seed)[1]
    return load_estimators(["causal"])["causal"](recording)
