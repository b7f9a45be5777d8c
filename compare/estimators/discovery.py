"""Which callable of a file is the estimator, where nobody names it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from slamgauge.compare.estimators.adapters import EXAMPLES, FORMS, NAMES
from slamgauge.compare.estimators.external_program import ExternalProgram
from slamgauge.compare.estimators.fresh_modules import Fresh
from slamgauge.compare.estimators.signatures import required
from slamgauge.compare.estimators.step_function import StepFunction
from slamgauge.compare.estimators.user_code import Address, load_own_module, load_whole_module
from slamgauge.errors import UserError


def found_in(where: Address) -> Address:
    """The address of the estimator in a file. THIS RUNS THAT CODE.

    It is what is called `estimate`, `ekf_slam`, `prediction_step` or `predict`, the first of them that has one of the
    forms; otherwise the only online class, otherwise the only callable of any form. What a file imports does not count,
    unless it bears one of those names.

    Raises:
        UserError: it cannot be loaded, or holds none or several.
    """
    module = load_whole_module(where)
    named = [name for name in NAMES if _has_a_form(module, name)]
    others = [name for name in _own_names(module) if _has_a_form(module, name)]
    classes = [name for name in others if isinstance(getattr(module, name), type)]
    for found in (named[:1], classes, others):
        if len(found) == 1:
            return where._replace(attribute=found[0])
    if others:
        remedy = f"call the one that counts {NAMES[0]}"
        raise UserError(f"{where.text}: may be {', '.join(others)}; {remedy}")
    _require_no_exit(where)
    raise UserError(f"{where.text}: defines no callable of a form that is known; give {', '.join(EXAMPLES)}")


def _has_a_form(module: ModuleType, name: str) -> bool:
    given: Any = getattr(module, name, None)
    if isinstance(given, ExternalProgram | StepFunction):
        return True
    if not callable(given):
        return False
    if name == NAMES[0] or _takes_a_recording(given):
        return len(required(given)) == 1
    return any(form.description(Fresh(given, vars(module))) is not None for form in FORMS)


def _takes_a_recording(given: Callable[..., object]) -> bool:
    return not isinstance(given, type) and required(given) == ["recording"]


def _own_names(module: ModuleType) -> Iterator[str]:
    """Public names of what the module itself defines."""
    for name, given in vars(module).items():
        is_own = getattr(given, "__module__", None) == module.__name__
        if not name.startswith("_") and (is_own or isinstance(given, ExternalProgram | StepFunction)):
            yield name


def _require_no_exit(where: Address) -> None:
    """Say so, if the file has left before it defined anything."""
    try:
        load_own_module(where._replace(attribute=NAMES[0]))
    except UserError as error:
        if isinstance(error.__cause__, SystemExit):
            raise
