"""Table of the corrections: their names, estimators and kernels.

A new correction needs a rule here, its kernel in `kernels.corrections` or `kernels.linearisation`, a callable in
`slamgauge.ekf.estimators`, and its entry in the registry of `slamgauge.compare.estimators`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Literal, NamedTuple, cast, get_args

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels import slots
from slamgauge.ekf.kernels.belief import AT_POINT, Belief
from slamgauge.ekf.kernels.corrections import (
    retract_right_invariant,
    retract_standard,
    update_right_invariant,
    update_standard,
)
from slamgauge.ekf.kernels.deferred_downdate import Deferred
from slamgauge.ekf.kernels.iterated_update import MAX_PASSES, update_iterated
from slamgauge.ekf.kernels.linearisation import PROJECTED
from slamgauge.ekf.kernels.prediction import predict
from slamgauge.ekf.kernels.sequential_association import Sequential
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Correction = Literal["standard", "first-estimates", "observability-constrained", "iterated", "right-invariant"]
Predict = Callable[[Belief, Float, Float], bool]
FindSlots = Callable[[Int, Int, Int, Int], int]
Update = Callable[[int, Belief, int, Workspace], tuple[float, int]]
Retract = Callable[[Belief, Float, Deferred], None]

WHOLE_SCAN = sys.maxsize
BLOCK = 16  # observations per block of an update; see docs/performance.md
ROWS = 64  # largest number of deferred rows: more save nothing and take longer to apply


class Rule(NamedTuple):
    """How a filter computes a step.

    Attributes:
        update: corrects with a scan.
        retract: moves the state by a given correction (see `kernels.linear_update`).
        first_estimates: whether the belief stores first estimates, for the prediction and for Jacobians.
        form: form of the Jacobians of observations (`Belief.form`).
        block: observations per block of an update.
        deferred_rows: sides and rows of deferred downdates (see `kernels.deferred_downdate`). There must be no rows
            with an update that reads the covariances between landmarks.
        sequential: how it corrects with one observation after the other; None if this is not possible.
        predict: moves the robot.
        find_slots: finds the landmarks of a scan. `update`, `predict` and `find_slots` are all compiled code of a step
            with known association; `slamgauge bench` replaces them by timed ones.
        estimator: name of the estimator, for notices.
    """

    update: Update
    retract: Retract = retract_standard
    first_estimates: bool = False
    form: int = AT_POINT
    block: int = BLOCK
    deferred_rows: tuple[int, int] = (1, 0)
    sequential: Sequential | None = None
    predict: Predict = predict
    find_slots: FindSlots = slots.find_slots
    estimator: str = "the filter"


_STANDARD = Rule(update_standard, deferred_rows=(1, ROWS), sequential=Sequential(), estimator="ekf")

RULES: dict[Correction, Rule] = {
    "standard": _STANDARD,
    "first-estimates": _STANDARD._replace(first_estimates=True, estimator="fej-ekf"),
    "observability-constrained": _STANDARD._replace(first_estimates=True, form=PROJECTED, estimator="oc-ekf"),
    "iterated": Rule(update_iterated, block=WHOLE_SCAN, sequential=Sequential(passes=MAX_PASSES), estimator="iekf"),
    "right-invariant": Rule(
        update_right_invariant,
        retract_right_invariant,
        deferred_rows=(2, ROWS),
        sequential=Sequential(invariant=True),
        estimator="riekf",
    ),
}
assert {*RULES} == {*get_args(Correction)}
CORRECTIONS: dict[str, Correction] = {rule.estimator: name for name, rule in RULES.items()}


def rule_of(correction: Correction | Rule) -> Rule:
    """Return the rule of that name, or the rule itself.

    Raises:
        UserError: an unknown correction, or a rule with an invalid block.
    """
    if isinstance(correction, Rule):
        if correction.block < 1:
            raise UserError(f"correction: a rule with block={correction.block} is invalid; give at least 1")
        if correction.update is update_iterated and correction.block != WHOLE_SCAN:
            raise UserError("correction: the iterated update needs the whole scan; give block=WHOLE_SCAN")
        return correction
    if not isinstance(cast("object", correction), str):
        raise UserError(
            f"correction: {correction!r} is not a correction; use one of {', '.join(RULES)}, or your own Rule"
        )
    if correction in RULES:
        return RULES[correction]
    if correction in CORRECTIONS:
        remedy = f"the estimator of that name uses {CORRECTIONS[correction]!r}"
    else:
        remedy = did_you_mean(str(correction), RULES, f"use one of {', '.join(RULES)}, or your own Rule")
    raise UserError(f"correction: {correction!r} is not known; {remedy}")


def sequential_of(rule: Rule) -> Sequential:
    """Return how the rule corrects with one observation after the other.

    Raises:
        UserError: this is not possible.
    """
    if rule.sequential is None:
        remedy = "give its `sequential` form, or associate by 'jcbb'"
        raise UserError(f"correction: this rule cannot correct observation by observation; {remedy}")
    return rule.sequential
