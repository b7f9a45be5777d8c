"""Forms and parameters of user code, and the refusal of code that has none of the forms."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, Literal

from slamgauge.compare.estimators.user_errors import PAGE, FormError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Callee = Callable[..., Any]
Noise = Literal["recording", "file"]  # the noise that user code assumes
SHOWN = 8  # functions or methods of a refusal
MOVING = ("predict", "motion", "propagate", "move")  # parts of usual names
OBSERVING = ("update", "correct", "measure", "observ", "sens")
FILTERS = ("ekf", "slam", "filter")
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
STEP = """import numpy as np
from {module} import {name}

DT, Q, Py = 0.1, np.eye(2), np.eye(2)  # slamgauge sets the length of a step [s], and the noise of u and y


def step(xEst, PEst, u, y):  # (n, 1), (n, n); (2, 1) speed [m/s], yaw rate [rad/s]; (m, 3) range [m], bearing [rad], id
    return {call}  # u * DT is the increment
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


def is_filter(given: Callee) -> bool:
    """Return whether a class or function is a filter by its name, or has methods with usual names for both halves."""
    names = [each.__name__.lower() for each in functions_of(given)] if isinstance(given, type) else []
    halves = [any(word in name for word in words for name in names) for words in (MOVING, OBSERVING)]
    return all(halves) or any(word in given.__name__.lower() for word in FILTERS)


def functions_of(owner: type | ModuleType) -> list[Callee]:
    """Return the public methods of a class, or the public functions that a module defines."""
    home = owner.__module__ if isinstance(owner, type) else owner.__name__
    named = [each for name, each in vars(owner).items() if name[0] != "_" and inspect.isfunction(each)]
    return [each for each in named if each.__module__ == home]


def no_form(given: Callee | ModuleType, lacks: str) -> FormError:
    """Return the error of a class, or of the functions of a module, without a known form.

    Its three lines are what the code has, what it lacks, and the remedy; the wrapper to copy follows.
    """
    is_class = isinstance(given, type)
    owner = given if isinstance(given, type | ModuleType) else sys.modules[given.__module__]
    parts = functions_of(owner)
    has = ", ".join(map(spelt, parts[:SHOWN])) or ("no methods" if is_class else "no function and no class")
    moving = [each for word in MOVING for each in parts if word in each.__name__.lower()]
    observing = [each for word in OBSERVING for each in parts if word in each.__name__.lower() and each not in moving]
    moves = spelt(moving[0]) if moving else "predict(...)"
    observes = spelt(observing[0]) if observing else "update(...)"
    start = getattr(given, "__init__", None)
    names = start.__code__.co_names if is_class and inspect.isfunction(start) else ()
    call = "self.filter." if is_class else "self.x, self.P = "
    made = f"self.filter = {spelt(given).removeprefix('class ')}  # and let it start at the prior"
    wrapper = WRAPPER.format(
        module=owner.__module__ if is_class else owner.__name__,
        imported=given.__name__ if is_class else ", ".join(each.__name__ for each in moving[:1] + observing[:1]) or "*",
        start=made if is_class else "self.x, self.P = prior_mean, prior_cov",
        moves=call + moves,
        observes=call + observes,
        owner="self.filter" if is_class else "self",
        mean=next((each for each in MEANS if each in names), "x"),
        cov=next((each for each in COVARIANCES if each in names), "P"),
    )
    steps = [each for each in parts if any(word in each.__name__.lower() for word in FILTERS)]
    is_step = not (is_class or moving or observing) and len(steps) > 0
    if is_step:
        wrapper = STEP.format(module=owner.__name__, name=steps[-1].__name__, call=spelt(steps[-1]))
    where = f"FILE.py:{'step' if is_step else 'Wrapper'} ({PAGE})"
    remedy = f"copy this wrapper into another file, fill in its arguments, and give {where}"
    return FormError(f"{spelt(given) if is_class else 'the file'} has {has}\nit lacks {lacks}\n{remedy}:\n\n{wrapper}")


def shortened(error: Exception) -> str:
    """Return an error in one line; a refusal without its wrapper."""
    lines = str(error).split("\n")
    return lines[0] if len(lines) < 3 else f"{lines[0]}; {lines[1]}; hand in a wrapper ({PAGE})"
