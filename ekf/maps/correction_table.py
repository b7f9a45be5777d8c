"""Table of the corrections: their names, estimators and kernels.

A new correction needs a rule here, its place in `kernels.update` or `kernels.linearisation`, a callable in
`slamgauge.ekf.estimators`, and its entry in the registry of `slamgauge.compare.estimators`.
"""

from __future__ import annotations

import sys
from typing import Literal, NamedTuple, get_args

from slamgauge.ekf.kernels.belief import AT_POINT
from slamgauge.ekf.kernels.linearisation import PROJECTED
from slamgauge.ekf.kernels.update import Form
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

Correction = Literal["standard", "first-estimates", "observability-constrained", "iterated", "right-invariant"]

WHOLE_SCAN = sys.maxsize
BLOCK = 16  # observations per block of an update; see docs/limits.md


class Rule(NamedTuple):
    """How a filter computes a step.

    Attributes:
        estimator: name of the estimator, for notices.
        form: of the update.
        first_estimates: whether the belief stores first estimates, for the prediction and for Jacobians.
        jacobians: form of the Jacobians of observations (`Belief.form`).
        block: observations per block of an update.
    """

    estimator: str
    form: Form = Form()
    first_estimates: bool = False
    jacobians: int = AT_POINT
    block: int = BLOCK


RULES: dict[Correction, Rule] = {
    "standard": Rule("ekf"),
    "first-estimates": Rule("fej-ekf", first_estimates=True),
    "observability-constrained": Rule("oc-ekf", first_estimates=True, jacobians=PROJECTED),
    "iterated": Rule("iekf", Form(iterated=True), block=WHOLE_SCAN),
    "right-invariant": Rule("riekf", Form(invariant=True)),
}
assert {*RULES} == {*get_args(Correction)}
CORRECTIONS: dict[str, Correction] = {rule.estimator: name for name, rule in RULES.items()}


def rule_of(correction: Correction) -> Rule:
    """Return the rule of that name.

    Raises:
        UserError: an unknown correction.
    """
    name = str(correction)
    for known, rule in RULES.items():
        if name == known:
            return rule
    remedy = did_you_mean(name, RULES, f"use one of {', '.join(RULES)}")
    if name in CORRECTIONS:
        remedy = f"the estimator of that name uses {CORRECTIONS[name]!r}"
    raise UserError(f"correction: {correction!r} is not known; {remedy}")
