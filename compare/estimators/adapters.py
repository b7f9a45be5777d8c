"""Forms of user code, made into estimators `Recording -> Estimate`: `slamgauge.adapters`.

The form of a callable follows from its signature; `adapt` prints it on standard error.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from types import ModuleType
from typing import Any

from slamgauge.compare.estimators.forms import octave_course, online_class, predict_update, usual_class
from slamgauge.compare.estimators.forms import step_function as steps
from slamgauge.compare.estimators.forms.external_program import ExternalProgram, external
from slamgauge.compare.estimators.forms.form import Form
from slamgauge.compare.estimators.forms.signatures import required
from slamgauge.compare.estimators.forms.step_function import StepFunction
from slamgauge.compare.estimators.fresh_modules import AddressedCode, Fresh, GivenCode, uncopied
from slamgauge.compare.estimators.pair_files import CORRECTIONS, PREDICTIONS
from slamgauge.compare.estimators.private_import import in_use, remarks_on_loading
from slamgauge.compare.estimators.user_code import Address, Callee, Noise, load_callable_module, load_whole_module
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.recording import Recording

__all__ = ["adapt", "external", "step_function"]


FORMS = (
    Form(
        "ntnu-class",
        predict_update.class_description,
        predict_update.PredictUpdate,
        "a class with predict(eta, P, z_odo), update(eta, P, z)",
    ),
    Form(
        "usual-class", usual_class.description, usual_class.UsualClass, "a class with predict(v, w, dt), update(z, id)"
    ),
    Form("class", online_class.description, online_class.OnlineClass, "a class with predict and update"),
    Form(
        "octave",
        octave_course.description,
        octave_course.CourseSteps,
        "prediction_step(mu, sigma, u) with correction_step(mu, sigma, z, observed)",
    ),
    Form(
        "predict-update",
        predict_update.description,
        predict_update.PredictUpdate,
        "predict(eta, P, z_odo) with update(eta, P, z)",
    ),
    Form("step", steps.description, StepFunction, "ekf_slam(xEst, PEst, u, y)"),
)
WITH_NOISE = (StepFunction, octave_course.CourseSteps, predict_update.PredictUpdate, usual_class.UsualClass)
FORM_NAMES = tuple(form.name for form in FORMS)
EXAMPLES = ("estimate(recording)", *(form.example for form in FORMS))
NAMES = ("estimate", "ekf_slam", PREDICTIONS[0], predict_update.PREDICT)  # searched for in a module, in this order
COURSE_NAMES = (*PREDICTIONS, *CORRECTIONS)  # searched for afterwards


def adapt(given: Callee | ModuleType, name: str) -> Estimator:
    """Make an estimator from a callable of any form, and print its form on standard error.

    Args:
        given: a callable, or a module that `estimators_in` finds one callable in.
        name: name of the estimator in messages.

    Raises:
        UserError: the callable has none of the forms.
    """
    estimator, form = adapted_callable(given, name)
    if form:
        print(f"{name}: {form}", file=sys.stderr)
    return estimator


def adapted_callable(given: Callee | ModuleType, name: str) -> tuple[Estimator, str]:
    """Adapt without printing; return the estimator and its form in words, empty for `Recording -> Estimate`."""
    if isinstance(given, ModuleType):
        named = [each for each in NAMES if callable(getattr(given, each, None))]
        found = estimators_in(given) or named[:1]
        if len(found) != 1:
            what = f"may be {', '.join(found)}" if found else f"has no {', '.join(NAMES)} of a form that is known"
            raise UserError(f"estimator {name}: module {given.__name__} {what}; name its callable")
        callee: Callee = getattr(given, found[0])
    else:
        callee = given
    form, words = _form_of(uncopied(callee), name)
    return callee if form is None else form.estimator(GivenCode(callee)), words


def adapted(where: Address) -> tuple[Estimator, str]:
    """`adapted_callable` for user code at an address; `Recording -> Estimate` is not loaded again for each run."""
    where = where if where.attribute else found_in(where)
    module = load_callable_module(where)
    callee = getattr(module, where.attribute)
    form, words = _form_of(Fresh(callee, vars(module)), where.label, where.form)
    words = "; ".join(each for each in (words, *remarks_on_loading(module)) if each)
    if form is not None:
        return _with_noise(form.estimator(AddressedCode(where, module)), where), words

    def run(recording: Recording) -> Estimate:
        with in_use(module):
            return callee(recording)

    return run, words


def found_in(where: Address) -> Address:
    """Return the address of the only estimator in a file (see `estimators_in`). THIS RUNS USER CODE.

    Raises:
        UserError: the file cannot be loaded, or contains no estimator or several.
    """
    found = estimators_in(load_whole_module(where))
    if len(found) == 1:
        return where._replace(attribute=found[0])
    if found:
        name = f"name it, {where.text}:{found[0]}, or call the one that counts {NAMES[0]}"
        raise UserError(f"{where.text}: may be {', '.join(found)}; {name}")
    try:
        load_callable_module(where._replace(attribute=NAMES[0]))
    except UserError as error:
        if isinstance(error.__cause__, SystemExit):  # the file called `exit()` before it defined anything
            raise
    raise UserError(f"{where.text}: defines no callable of a form that is known; give {', '.join(EXAMPLES)}")


def estimators_in(module: ModuleType) -> list[str]:
    """Return the names of the callables that may be the estimator of a module; one name if it is clear.

    First choice is `estimate`, `ekf_slam`, `prediction_step`, `predict` or another name of the Octave course's
    functions, the first of them that has one of the forms; then the only online class; then all callables of any form.
    An imported callable counts only under those names.
    """
    named = [name for name in NAMES if _has_a_form(module, name)]
    named += [name for name in COURSE_NAMES if _is_of_the_course(module, name)]
    others = [name for name in vars(module) if _is_defined_by(module, name) and _has_a_form(module, name)]
    classes = [name for name in others if isinstance(getattr(module, name), type)]
    return named[:1] or (classes if len(classes) == 1 else others)


def _has_a_form(module: ModuleType, name: str) -> bool:
    given: Any = getattr(module, name, None)
    if isinstance(given, ExternalProgram | StepFunction):
        return True
    if not callable(given):
        return False
    parameters = required(given)
    if name == NAMES[0] or (parameters == ["recording"] and not isinstance(given, type)):
        return len(parameters) == 1
    return any(form.description(Fresh(given, vars(module))) is not None for form in FORMS)


def _is_of_the_course(module: ModuleType, name: str) -> bool:
    callee = getattr(module, name, None)
    return callable(callee) and octave_course.description(Fresh(callee, vars(module))) is not None


def _is_defined_by(module: ModuleType, name: str) -> bool:
    given = getattr(module, name)
    is_own = getattr(given, "__module__", None) == module.__name__
    return not name.startswith("_") and (is_own or isinstance(given, ExternalProgram | StepFunction))


def _form_of(fresh: Fresh, name: str, requested: str = "") -> tuple[Form | None, str]:
    """Return the form of a callable and its description; None for one that takes a recording.

    `requested` is the name of its form, if the user gives it.

    Raises:
        UserError: the callable has none of the forms, or not the requested one.
    """
    forms = [form for form in FORMS if requested in ("", form.name)]
    if not forms:
        raise UserError(f"estimator {name}: no form is named {requested!r}; use one of {', '.join(FORM_NAMES)}")
    for form in forms:
        words = form.description(fresh)
        if words is not None:
            return form, words
    if requested:
        what = f"{_signature(fresh.callee)} has not the form {requested}"
        raise UserError(f"estimator {name}: {what}; give {forms[0].example}")
    if isinstance(fresh.callee, type) or len(required(fresh.callee)) > 1:
        what = f"{_signature(fresh.callee)} has none of the forms that are known"
        raise UserError(f"estimator {name}: {what}; give {', or '.join(EXAMPLES)}")
    return None, ""


def step_function(given: Callee, noise: Noise = "recording") -> StepFunction:
    """Make an estimator from a step function of the exercise.

    Args:
        given: `ekf_slam(xEst, PEst, u, y) -> xEst, PEst`.
        noise: `recording` sets its globals Q and Py to the noise of the recording; `file` keeps those of its file.

    Raises:
        UserError: unknown noise, or a callable of another form.
    """
    if noise not in ("recording", "file"):
        raise UserError(f"noise: {noise!r} is not known; use 'recording' or 'file'")
    if steps.description(uncopied(given)) is None:
        raise UserError(f"step_function: {_signature(given)} has another form; give ekf_slam(xEst, PEst, u, y)")
    return StepFunction(GivenCode(given), noise)


def _with_noise(estimator: Estimator, where: Address) -> Estimator:
    """Set the field `noise` of an estimator, for forms that can use the noise of the file."""
    if isinstance(estimator, WITH_NOISE):
        return replace(estimator, noise=where.noise)
    if where.noise == "file":
        raise UserError(f"estimator {where.label}: its form has no noise to choose; leave out --noise")
    return estimator


def _signature(given: Callee) -> str:
    kind = "class " if isinstance(given, type) else ""
    return f"{kind}{getattr(given, '__name__', repr(given))}({', '.join(required(given))})"
