"""Forms of user code, made into estimators `Recording -> Estimate`: `slamgauge.adapters`.

The form of a callable follows from its parameters and methods. Nothing else is tried: code of another form needs a
wrapper (docs/your_filter.md, examples/adapters).
"""

from __future__ import annotations

from types import ModuleType
from typing import get_args

from slamgauge.compare.estimators.forms import online_class
from slamgauge.compare.estimators.forms import step_function as steps
from slamgauge.compare.estimators.forms.external_program import external
from slamgauge.compare.estimators.forms.online_class import OnlineClass
from slamgauge.compare.estimators.forms.signatures import Callee, Form, Noise, is_filter, no_form, required, spelt
from slamgauge.compare.estimators.forms.step_function import StepFunction
from slamgauge.compare.estimators.user_errors import FormError
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator

__all__ = ["adapt", "external", "step_function"]

NAMES = ("estimate", "ekf_slam")  # names of the callable that counts, in this order
FORMS = "estimate(recording), ekf_slam(xEst, PEst, u, y), or a class with predict(increment, cov), update(observations)"


def adapt(given: Callee, name: str) -> Estimator:
    """Make an estimator from a callable of any form.

    Args:
        given: the callable.
        name: name of the estimator in messages.

    Raises:
        UserError: the callable has none of the forms.
    """
    try:
        return adapted(given)
    except FormError as error:
        raise FormError(f"estimator {name}: {error}") from None


def adapted(given: Callee) -> Estimator:
    """Return the estimator of a callable, no `Form` if it is `Recording -> Estimate`; `FormError`: it has no form."""
    if isinstance(given, type):
        if lacking := online_class.lacks(given):
            raise no_form(given, f"{lacking}, pose, pose_cov")
        return OnlineClass(given)
    if steps.is_step_function(given):
        if lacking := steps.lacks(given):
            raise no_form(given, lacking if is_filter(given) else FORMS)
        return StepFunction(given)
    if len(required(given)) > 1:
        raise no_form(given, FORMS)
    return given


def step_function(given: Callee, noise: Noise = "recording") -> StepFunction:
    """Make an estimator from a step function of the exercise.

    Args:
        given: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.
        noise: `recording` sets its globals Q and Py to the noise of the recording; `file` keeps those of its file.

    Raises:
        UserError: unknown noise, or a callable of another form.
    """
    if noise not in get_args(Noise):
        raise UserError(f"noise: {noise!r} is not known; use 'recording' or 'file'")
    if not steps.is_step_function(given) or steps.lacks(given):
        what = f"step_function: {spelt(given)} has another form"
        raise UserError(f"{what}; give ekf_slam(xEst, PEst, u, y) that reads DT")
    return StepFunction(given, noise)


def callable_of(module: ModuleType) -> str:
    """Return the name of the callable of a module that counts.

    It is `estimate` or `ekf_slam`, imported ones too; else the only class, or else the only callable, of a known form
    that the module defines.

    Raises:
        FormError: the module has none of a known form.
        UserError: it may be several.
    """
    named = [name for name in NAMES if callable(getattr(module, name, None))]
    public = {name: each for name, each in vars(module).items() if name[0] != "_" and callable(each)}
    home = module.__name__
    own = {k: v for k, v in public.items() if isinstance(v, Form) or getattr(v, "__module__", None) == home}
    formed = [name for name, each in own.items() if _has_a_form(each)]
    classes = [name for name in formed if isinstance(own[name], type)]
    found = named[:1] or (classes if len(classes) == 1 else formed)
    if len(found) > 1:
        remedy = f"name it, FILE.py:{found[0]}, or call the one that counts {NAMES[0]}"
        raise UserError(f"may be {', '.join(found)}; {remedy}")
    found = found or [name for name, each in own.items() if isinstance(each, type) and is_filter(each)][-1:]
    if not found:
        raise no_form(module, FORMS)
    return found[0]  # `adapted` names what a filter lacks


def _has_a_form(given: Callee) -> bool:
    try:
        return isinstance(adapted(given), Form) or required(given) == ["recording"]
    except FormError:
        return False
