"""People's own filters as they are, made into estimators `Recording -> Estimate`: `slamgauge.adapters`.

The form is found from the signature of what they bring (`adapt`), and said on standard error.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

from slamgauge.compare.estimators import course_steps, online_class, predict_update
from slamgauge.compare.estimators import step_function as steps
from slamgauge.compare.estimators.external_program import external
from slamgauge.compare.estimators.fresh_modules import AddressedCode, Code, Fresh, GivenCode, as_it_stands
from slamgauge.compare.estimators.private_import import present
from slamgauge.compare.estimators.signatures import required
from slamgauge.compare.estimators.step_function import Noise, StepFunction
from slamgauge.compare.estimators.user_code import Address, Callee, load_own_module
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

__all__ = ["adapt", "external", "step_function"]


class Form(NamedTuple):
    """A form in which people bring their filters.

    Attributes:
        description: what they are told of a callable of this form; None for another.
        estimator: what makes an estimator of their code.
        example: how it is spelt.
    """

    description: Callable[[Fresh], str | None]
    estimator: Callable[[Code], Estimator]
    example: str


FORMS = (
    Form(online_class.description, online_class.OnlineClass, "a class with predict and update"),
    Form(
        course_steps.description,
        course_steps.CourseSteps,
        "prediction_step(mu, sigma, u) with correction_step(mu, sigma, z, observed)",
    ),
    Form(
        predict_update.description,
        predict_update.PredictUpdate,
        "predict(eta, P, z_odo) with update(eta, P, z)",
    ),
    Form(steps.description, StepFunction, "ekf_slam(xEst, PEst, u, y)"),
)
EXAMPLES = ("estimate(recording)", *(form.example for form in FORMS))
NAMES = ("estimate", "ekf_slam", course_steps.PREDICTION, predict_update.PREDICT)  # looked for in a module


def adapt(given: Callee | ModuleType, name: str, *, announced: bool = True) -> Estimator:
    """An estimator of a callable, or of a module that has one, in any of the forms.

    Args:
        given: a callable; of a module its `estimate`, `ekf_slam`, `prediction_step` or `predict` is taken, or its only
            class with `predict` and `update`.
        name: what it is called on standard error.
        announced: whether its form is said there.

    Raises:
        UserError: it has none of the forms.
    """
    callee = _within(given, name) if isinstance(given, ModuleType) else given
    form = _form_of(as_it_stands(callee), name, announced=announced)
    return callee if form is None else form.estimator(GivenCode(callee))


def adapted(where: Address, *, announced: bool = True) -> Estimator:
    """`adapt` for what stands in a file or module; but for a callable `Recording -> Estimate` loaded for every run."""
    module = load_own_module(where)
    callee = getattr(module, where.attribute)
    form = _form_of(Fresh(callee, vars(module)), where.label, announced=announced)
    return LoadedCallable(callee, module) if form is None else form.estimator(AddressedCode(where, module))


@dataclass(frozen=True)
class LoadedCallable:
    """A callable `Recording -> Estimate` of a module that has been loaded; called like any."""

    callee: Callee
    module: ModuleType

    def __call__(self, recording: Recording) -> Estimate:
        """Run it."""
        with present(self.module):
            return self.callee(recording)


def _form_of(fresh: Fresh, name: str, *, announced: bool) -> Form | None:
    """The form of a callable, said on standard error if `announced`; None for one that takes a recording."""
    for form in FORMS:
        words = form.description(fresh)
        if words is not None:
            if announced:
                print(f"{name}: {words}", file=sys.stderr)
            return form
    if isinstance(fresh.callee, type) or len(required(fresh.callee)) > 1:
        what = f"{_spelt(fresh.callee)} has none of the forms that are known"
        raise UserError(f"estimator {name}: {what}; give {', or '.join(EXAMPLES)}")
    return None


def step_function(given: Callee, noise: Noise = "recording") -> StepFunction:
    """A step function of the practical as an estimator.

    Args:
        given: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.
        noise: what it assumes: `recording`, where its globals Q and Py are set to the recording's, or `file`.

    Raises:
        UserError: another noise, or a callable of another form.
    """
    if noise not in ("recording", "file"):
        raise UserError(f"noise: {noise!r} is not known; use 'recording' or 'file'")
    if steps.description(as_it_stands(given)) is None:
        raise UserError(f"step_function: {_spelt(given)} is none; give ekf_slam(xEst, PEst, u, y)")
    return StepFunction(GivenCode(given), noise)


def _spelt(given: Callee) -> str:
    kind = "class " if isinstance(given, type) else ""
    return f"{kind}{getattr(given, '__name__', repr(given))}({', '.join(required(given))})"


def _within(module: ModuleType, name: str) -> Callee:
    """What a module brings."""
    classes = [each for each in vars(module).values() if isinstance(each, type) and each.__module__ == module.__name__]
    online = [each for each in classes if online_class.description(as_it_stands(each)) is not None]
    named = [getattr(module, each) for each in NAMES if callable(getattr(module, each, None))]
    found = [*named, *(online if len(online) == 1 else [])]
    if not found:
        raise UserError(f"estimator {name}: module {module.__name__} has no {', '.join(NAMES)}; name its callable")
    return found[0]
