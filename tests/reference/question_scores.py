"""Scores of many independent runs of a question's scenario, with the true start drawn from the prior; cached."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from slamgauge import Score, evaluate, load_estimators, load_scenario, simulate
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.estimate import Estimate


class Expected(NamedTuple):
    """Bounds on mean ATE and mean ratio; mean and standard deviation over runs of the map size."""

    ate_m: float
    ratio: float
    mapped: tuple[float, float]


@cache
def scores(name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...] = ()) -> dict[str, list[Score]]:
    """Scores of `runs` runs (seeds 0, 1, ...) of each filter, against the truth alone."""
    return _scores(name, filters, runs, overrides, graded=False)


@cache
def graded_scores(
    name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...] = ()
) -> dict[str, list[Score]]:
    """The same next to the causal optimum, which is told true noise and associations."""
    return _scores(name, filters, runs, overrides, graded=True)


def _scores(
    name: str, filters: tuple[str, ...], runs: int, overrides: tuple[str, ...], *, graded: bool
) -> dict[str, list[Score]]:
    scenario = load_scenario(name, ["start=sampled", *overrides])
    estimators = load_estimators(
        filters, association=scenario.association, initialisation=scenario.initialisation_settings
    )
    told = informed(scenario).model_dump_json()
    found: dict[str, list[Score]] = {each: [] for each in filters}
    for seed in range(runs):
        truth, recording = simulate(scenario, seed)
        optimum = causal_optimum(told, seed) if graded else None
        for each, estimator in estimators.items():
            found[each].append(evaluate(truth, recording, estimator(recording), optimum))
    return found


@cache
def causal_optimum(scenario: str, seed: int) -> Estimate:
    """What causal makes of a run of the scenario given as JSON."""
    from slamgauge import Scenario

    recording = simulate(Scenario.model_validate_json(scenario), seed)[1]
    return load_estimators(["causal"])["causal"](recording)
