"""Constructors of user classes: arguments by parameter name, and noise that changes from step to step.

A class may store the noise that it receives as an attribute of any name. `StoredNoise` finds these attributes by their
value after construction, and noise of the file by its name, as an attribute or a global. It sets both to the noise of
each step and scan.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable
from types import FunctionType
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.inputs import noise_remark, shown
from slamgauge.compare.estimators.forms.names import Roles, role_of, words_of
from slamgauge.compare.estimators.forms.signatures import parameters
from slamgauge.compare.estimators.forms.step_source import names_read
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError

NOISE: Roles = {
    "motion": ("Q motion process control odometry", "u noise cov covariance matrix"),
    "measurement": ("R measurement meas sensor observation obs", "z noise cov covariance matrix"),
}
ROLES: Roles = {
    "sensor": ("sensor", ""),
    "offset": ("offset", "sensor"),
    "own association": ("asso association", "do"),
    "alphas": ("alpha alphas", ""),
    "y": ("y", "start init initial 0"),
    "theta": ("theta yaw", "start init initial 0"),
    "mean": ("x X mu state pose mean start", "init initial prior est robot 0"),
    "cov": ("P sigma cov covariance", "init initial prior start state pose est robot 0"),
    **NOISE,
    "dt": ("dt ts dtime timestep step", "time"),
    "count": ("n N M L m num number max count", "landmark landmarks lm features of"),
}
LETTERS = {"Q", "R"}  # courses disagree on which one is the noise of the motion
NOISE_WORDS = {"noise", "sigma", "std", "stddev", "var", "variance", "cov", "covariance", "Q", "R"}
NAMES = {"motion": "motion noise", "measurement": "observation noise"}


def roles_of(kind: Callee, known: Collection[str]) -> dict[str, str]:
    """Return the role of each constructor parameter that is in `known`, by parameter name.

    Raises:
        UserCodeError: a parameter without default has no known role.
    """
    given = parameters(kind)
    found = {each.name: role_of(each.name, ROLES) for each in given}
    if "y" in found.values():
        found |= {name: "x" for name in found if "x" in words_of(name)}
    roles = {name: role for name, role in found.items() if role is not None and role in known}
    lacking = [each.name for each in given if each.name not in roles and each.default is each.empty]
    if lacking:
        what = f"its constructor needs {', '.join(lacking)}, which no recording has under these names"
        raise UserCodeError(f"{what}; give defaults, or use the usual names, for example x0, P0, Q, R, n_landmarks, dt")
    return roles


def without_defaults(kind: Callee, roles: dict[str, str], optional: Collection[str]) -> dict[str, str]:
    """Return the roles without parameters that have a default and an `optional` role."""
    defaults = {each.name for each in parameters(kind) if each.default is not each.empty}
    return {name: role for name, role in roles.items() if role not in optional or name not in defaults}


def constructed(kind: Callee, roles: dict[str, str], values: dict[str, Any]) -> Any:
    """Return a new object of the class; arrays are copied."""
    return kind(
        **{name: np.array(v) if isinstance(v := values[role], np.ndarray) else v for name, role in roles.items()}
    )


def methods_in(kind: type) -> list[FunctionType]:
    """Return the functions of a class and its bases, without the constructor."""
    found = (f for base in kind.__mro__ for f in vars(base).values() if inspect.isfunction(f))
    return [each for each in found if each.__name__ != "__init__"]


class StoredNoise:
    """Noise covariances among the attributes of an object and the globals of its methods.

    Args:
        methods: the methods that run in a step, or functions of a module.
        slam: the new object; None for functions of a module. It gets its own copies of arrays of its class.
        passed: covariances that its constructor received, by role (`motion`, `measurement`).
        shapes: sizes of the covariances by role.
        noise: assumed noise: that of the recording, or that of the file.
    """

    def __init__(
        self,
        methods: Iterable[Any],
        slam: Any,
        passed: dict[str, Float],
        shapes: dict[str, tuple[int, int]],
        noise: Noise,
    ) -> None:
        functions = [inspect.unwrap(each) for each in methods]
        attributes: dict[str, Any] = getattr(slam, "__dict__", {})
        for base in type(slam).__mro__:
            for name, value in vars(base).items():
                if isinstance(value, np.ndarray):
                    attributes.setdefault(name, value.copy())
        spaces = [attributes, *(getattr(each, "__globals__", {}) for each in functions)]
        self._spaces = [*{id(each): each for each in spaces}.values()]
        self._is_replaced = noise == "recording"
        self._read = {name for each in functions for name in names_read(each)}
        self._stored = {  # attributes that have what the constructor received
            role: [name for name, value in attributes.items() if np.array_equal(_real(value), cov)]
            for role, cov in passed.items()
        }
        self._own = {  # noise of the file: spaces, names and values
            role: [
                (space, name, np.array(value, float))
                for space in self._spaces
                for name, value in space.items()
                if _real(value).shape == shape and role_of(name, NOISE) == role
            ]
            for role, shape in shapes.items()
            if role not in passed
        }

    def set(self, role: str, cov: Float) -> None:
        """Set all covariances of a role to the recording's, as far as its noise is assumed."""
        for name in self._stored.get(role, ()):
            self._spaces[0][name] = cov.copy()
        for space, name, _ in self._own.get(role, ()) if self._is_replaced else ():
            space[name] = cov.copy()

    def is_replaced(self, given: dict[str, Float]) -> bool:
        """Return whether the noise of the recording replaces another one of the file."""
        return self._is_replaced and any(self._compared(given).values())

    def remarks(self, given: dict[str, Float], ignored: Collection[str] = ()) -> list[str]:
        """Return sentences on the noise of the file: replaced covariances, and others that the file keeps.

        Args:
            given: first covariances of the recording, by role.
            ignored: names of attributes without noise.
        """
        found = self._compared(given)
        known = {*ignored, *(name for _, name in found), *(name for names in self._stored.values() for name in names)}
        others = {
            name: shown(value)
            for space in self._spaces
            for name, value in space.items()
            if name in self._read - known and words_of(name) & NOISE_WORDS and 0 < _real(value).size < 10
        }
        if others:
            values = ", ".join(f"{name} = {value}" for name, value in others.items())
            has = " and ".join(f"{NAMES[role]} {shown(cov)}" for role, cov in given.items())
            found["", ""] = f"its own noise, {values}, is kept; the recording has {has}"
        return [*filter(None, found.values())]

    def _compared(self, given: dict[str, Float]) -> dict[tuple[str, str], str]:
        """Return a sentence, or an empty text, for each covariance of the file, by role and name."""
        return {
            (role, name): noise_remark(f"{NAMES[role]} {name}", own, given[role], is_replaced=self._is_replaced)
            for role, places in self._own.items()
            for _, name, own in places
        }


def _real(value: object) -> Float:
    """Return a number or an array of numbers as an array; an empty one for anything else."""
    is_real = isinstance(value, np.ndarray | float | int) and not isinstance(value, bool)
    array = np.asarray(value) if is_real else np.zeros(0)
    return array if array.dtype.kind in "fiu" else np.zeros(0)
