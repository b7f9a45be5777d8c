"""Comparison with a reference on the same runs: which differences fail, and which pass."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.scoring.aggregation import FIRST_STEP
from slamgauge.compare.scoring.error_bounds import NO_COVS, against_reference, assert_error_bounds
from slamgauge.compare.scoring.scores import Score
from slamgauge.errors import UserError

from .test_assertions import resting_run

STEPS = 30


def scores(
    ate: float = 1.0, nees: float = 3.0, sigma: float = 1.0, heading: float = 1.0, spread: float = 0.0, runs: int = 20
) -> list[Score]:
    """Return scores with these figures, times a factor that estimators share and an own factor of `spread`."""
    shared, own = np.random.default_rng(0), np.random.default_rng(1)
    found: list[Score] = []
    for _ in range(runs):
        factor = shared.lognormal(0.0, 0.3) * own.lognormal(0.0, spread)
        found.append(
            replace(
                resting_run(0),
                ate_m=ate * factor,
                nees=np.full(STEPS + 1, nees * factor),
                sigmas=np.tile([sigma, sigma, heading], (STEPS + 1, 1)),
            )
        )
    return found


def broken(ours: list[Score], reference: list[Score]) -> str:
    return "\n".join(against_reference(ours, reference).broken)


def test_the_reference_keeps_its_own_bounds_and_its_ratios_are_one():
    found = against_reference(scores(nees=9.0), scores(nees=9.0))
    assert found.broken == ()
    for ratio in (found.ate, found.nees, found.sigma_position, found.sigma_heading):
        assert ratio is not None and ratio == pytest.approx((1.0, 1.0, 1.0))


def test_pairing_removes_the_variation_that_runs_share():
    worse = against_reference(scores(ate=1.1), scores())
    assert worse.ate is not None and worse.ate.low == pytest.approx(1.1)
    assert worse.broken == ("ATE is 1.1 ± 0 times the reference's, more than 1.05",)


def test_insignificant_differences_pass():
    found = against_reference(scores(ate=1.1, spread=0.5), scores())
    assert found.ate is not None and found.ate.mean > 1.05 > found.ate.low  # pyright: ignore[reportOperatorIssue]
    assert found.broken == ()


@pytest.mark.parametrize(
    ("ours", "reference", "said"),
    [
        ({"nees": 9.0}, {"nees": 6.0}, "NEES is 1.5 ± "),
        ({"nees": 2.0}, {"nees": 1.0}, ""),  # at most a consistent estimate's
        (
            {"sigma": 0.8, "nees": 4.0},
            {"nees": 4.0},
            "sigma of the position is 0.8 ± 0 times the reference's, less than 0.9",
        ),
        (
            {"heading": 1.3, "nees": 1.0},
            {"nees": 3.0},
            "sigma of the heading is 1.3 ± 0 times the reference's, more than 1.1",
        ),
        ({"sigma": 1.5, "heading": 1.5, "nees": 3.0}, {"nees": 9.0}, ""),  # the reference is too sure
        ({"sigma": 0.5, "nees": 3.0}, {"nees": 1.0}, ""),  # the reference is too cautious
        ({"sigma": 0.5, "nees": 9.0}, {"nees": 1.0}, "NEES is 9 ± "),
        ({"ate": 0.5, "nees": 3.0, "sigma": 1.2}, {"nees": 9.0}, ""),
    ],
)
def test_rules(ours: dict[str, Any], reference: dict[str, Any], said: str):
    found = broken(scores(**ours), scores(**reference))
    assert found.startswith(said) if said else not found


def test_without_covariances_an_estimator_fails():
    bare = [replace(each, nees=np.full(STEPS + 1, np.nan), sigmas=np.full((STEPS + 1, 3), np.nan)) for each in scores()]
    assert against_reference(bare, scores()).broken == (NO_COVS,)
    assert against_reference(bare, bare).broken == ()


def test_the_first_steps_do_not_count():
    ours = scores()
    for each in ours:
        each.nees[:FIRST_STEP] = 1e6
        each.sigmas[:FIRST_STEP] = 0.0
    assert against_reference(ours, scores()).broken == ()


@pytest.mark.parametrize(
    ("ours", "reference", "said"),
    [(3, 2, "2 scores for 3 of other runs"), (1, 1, "a single run has no interval"), (0, 0, "a single run")],
)
def test_runs_that_cannot_be_compared(ours: int, reference: int, said: str):
    with pytest.raises(UserError, match=said):
        against_reference(scores(runs=ours), scores(runs=reference))


def test_the_assertion_has_the_same_lines():
    reference = scores(nees=9.0)
    assert_error_bounds(scores(nees=9.0), reference=reference)
    with pytest.raises(AssertionError) as caught:
        assert_error_bounds(scores(ate=1.2, nees=9.0, sigma=0.5), reference=reference, max_ate_m=100.0)
    assert str(caught.value).splitlines() == [
        "2 error bound(s) failed:",
        "  ATE is 1.2 ± 0 times the reference's, more than 1.05",
        "  sigma of the position is 0.5 ± 0 times the reference's, less than 0.9: it is too sure",
    ]
