"""Forms and parameters of user code, and the refusal of code that has none of the forms.

The refusal has what the code has, what it lacks, and the wrapper to copy.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from slamgauge.compare.estimators.user_errors import FormError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Callee = Callable[..., Any]
PAGE = "docs/your_filter.md"
SHOWN = 8  # functions or methods of a refusal
MOVING = ("predict", "motion", "propagate", "move")  # parts of usual names
OBSERVING = ("update", "correct", "measure", "observ", "sens")
MEANS, COVARIANCES = ("mu", "xEst", "X", "state", "mean", "eta"), ("Sigma", "sigma", "PEst", "cov", "covariance")
WRAPPER = """from {module} import {imported}


class Wrapper:  # comments: what slamgauge gives and reads
    def __init__(self, prior_mean, prior_cov):  # (3,) x, y [m], heading [rad]; (3, 3)
        {start}

    def predict(self, increment, cov):  # (3,) dx, dy [m], dtheta [rad] in the robot's frame; its noise (3, 3)
        {moves}

    def update(self, ids, values, covs):  # (m,); (m, 2) range [m], bearing [rad]; (m, 2, 2)
        for name, z, R in zip(ids, values, covs):
            {observes}

    pose = property(lambda self: {owner}.{mean}[:3])
    pose_cov = property(lambda self: {owner}.{cov}[:3, :3])
    landmark_ids = property(lambda self: list({owner}.index))
    landmarks = property(lambda self: {owner}.{mean}[3:].reshape(-1, 2))
"""


class Form:
    """User code of a known form, as an estimator.

    Attributes:
        words: its form in words.
        remarks: sentences on the last run: settings of the file that are replaced or kept.
        replaces_noise: whether the noise of the recording replaced another one of the file in the last run.
    """

    words: str = ""
    remarks: Sequence[str] = ()
    replaces_noise: bool = False

    def __call__(self, _recording: Recording, /) -> Estimate:
        """Return the estimate of a recording."""
        raise NotImplementedError


def parameters(given: object) -> list[inspect.Parameter]:
    """Return the positional parameters; an empty list if Python cannot read the signature."""
    try:
        found = inspect.signature(given).parameters.values()  # pyrefly: ignore[bad-argument-type]
    except (TypeError, ValueError):
        return []
    return [each for each in found if each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD)]


def required(given: object) -> list[str]:
    """Return the names of the positional parameters without a default."""
    return [each.name for each in parameters(given) if each.default is each.empty]


def spelt(given: object) -> str:
    """Return a callable with its parameters, for messages: `class EKF(Q, R)`."""
    kind = "class " if isinstance(given, type) else ""
    names = [each.name for each in parameters(given)]
    return f"{kind}{getattr(given, '__name__', repr(given))}({', '.join(names[names[:1] == ['self'] :])})"


def no_form(given: Callee, lacks: str) -> FormError:
    """Return the error of a class or function without a known form: what it has, and what it lacks."""
    parts = [*_parts(given)]
    owner = spelt(given) if isinstance(given, type) else "the file"
    has = ", ".join(map(spelt, parts[:SHOWN])) or ("no methods" if isinstance(given, type) else spelt(given))
    return FormError(f"{owner} has {has}; it lacks {lacks}", _wrapper(given, parts))


def _parts(given: Callee) -> Iterable[Callee]:
    """Yield the public methods of a class, or the public functions of the module of a function."""
    module = getattr(given, "__module__", "")
    owner = given if isinstance(given, type) else sys.modules.get(module)
    for name, each in [*vars(owner).items()] if owner is not None else []:
        if name[0] != "_" and inspect.isfunction(each) and each.__module__ == module:
            yield each


def _wrapper(given: Callee, parts: list[Callee]) -> str:
    """Return the wrapper of a class or of functions, with their names where these are usual."""
    module, name = str(given.__module__), getattr(given, "__name__", "Filter")
    moves, observes = _call(parts, MOVING), _call(parts, OBSERVING)
    if isinstance(given, type):
        names = given.__init__.__code__.co_names if inspect.isfunction(given.__init__) else ()
        filled = {
            "imported": name,
            "start": f"self.filter = {spelt(given).removeprefix('class ')}  # and let it start at the prior",
            "moves": f"self.filter.{moves}",
            "observes": f"self.filter.{observes}",
            "owner": "self.filter",
            "mean": next((each for each in MEANS if each in names), "x"),
            "cov": next((each for each in COVARIANCES if each in names), "P"),
        }
    else:
        filled = {
            "imported": ", ".join(each.partition("(")[0] for each in (moves, observes)),
            "start": "self.x, self.P = prior_mean, prior_cov",
            "moves": f"self.x, self.P = {moves}",
            "observes": f"self.x, self.P = {observes}",
            "owner": "self",
            "mean": "x",
            "cov": "P",
        }
    return WRAPPER.format(module=module, **filled)


def _call(parts: list[Callee], words: tuple[str, ...]) -> str:
    """Return the call of the first function with one of these words in its name; its arguments are to be filled in."""
    found = (each for each in parts if any(word in each.__name__.lower() for word in words))
    return next(map(spelt, found), f"{words[0]}(...)")


def refusal(text: str, error: FormError) -> FormError:
    """Return the error of code at an address `text`, in three lines and the wrapper."""
    has, _, lacks = str(error).partition("; it lacks ")
    remedy = f"copy this wrapper into another file, fill in its arguments, and give FILE.py:Wrapper ({PAGE})"
    return FormError(f"estimator {text}: {has}\nit lacks {lacks}\n{remedy}:\n\n{error.wrapper}")


def shortened(error: Exception) -> str:
    """Return an error in one line; a refusal without its wrapper."""
    lines = str(error).split("\n")
    return lines[0] if len(lines) < 3 else f"{lines[0]}; {lines[1]}; hand in a wrapper ({PAGE})"
