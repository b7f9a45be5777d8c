"""Constructors of user classes: arguments by parameter name, and noise that changes from step to step.

A class may store the noise that it receives as an attribute of any name. `StoredNoise` finds these attributes by their
value after construction, and noise of the file by its name, as an attribute or a global. It sets both to the noise of
each step and scan.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable
from itertools import product
from types import FunctionType
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.inputs import noise_remark, shown
from slamgauge.compare.estimators.forms.names import Roles, role_of, words_of
from slamgauge.compare.estimators.forms.signatures import parameters, required
from slamgauge.compare.estimators.forms.step_source import names_read
from slamgauge.compare.estimators.user_code import Callee, Noise, UserCodeError

LETTERS = ("Q", "R")  # courses disagree on which one is the noise of the motion


def noise_roles(*, is_swapped: bool = False) -> Roles:
    """Return the roles of noise by name, with Q or, if swapped, R as that of the motion."""
    motion, measurement = reversed(LETTERS) if is_swapped else LETTERS
    return {
        "motion": (f"{motion} motion process control odometry", "u noise cov covariance matrix"),
        "measurement": (f"{measurement} measurement meas sensor observation obs", "z noise cov covariance matrix"),
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
    **noise_roles(),
    "dt": ("dt ts dtime timestep step", "time"),
    "count": ("n N M L m num number max count", "landmark landmarks lm features of"),
}
NOISE_WORDS = {"noise", "sigma", "std", "stddev", "var", "variance", "cov", "covariance", "Q", "R"}
NAMES = {"motion": "motion noise", "measurement": "observation noise"}


def roles_of(
    kind: Callee, known: Collection[str], optional: Collection[str] = (), *, is_swapped: bool = False
) -> dict[str, str]:
    """Return the role of each constructor parameter that is filled, by parameter name.

    Args:
        kind: the class.
        known: roles that have values.
        optional: roles whose parameters keep their defaults.
        is_swapped: whether R is the noise of the motion, and Q that of observations.

    Raises:
        UserCodeError: a parameter without default has no known role.
    """
    table = {**ROLES, **noise_roles(is_swapped=is_swapped)}
    found = {each.name: role_of(each.name, table) or "" for each in parameters(kind)}
    if "y" in found.values():
        found |= {name: "x" for name in found if "x" in words_of(name)}
    needed = required(kind)
    lacking = [name for name in needed if found[name] not in known]
    if lacking:
        what = f"its constructor needs {', '.join(lacking)}, which no recording has under these names"
        raise UserCodeError(f"{what}; give defaults, or use the usual names, for example x0, P0, Q, R, n_landmarks, dt")
    return {name: role for name, role in found.items() if role in known and (role not in optional or name in needed)}


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
        names: roles of names (`noise_roles`).
        noise: assumed noise: that of the recording, or that of the file.
    """

    def __init__(
        self,
        methods: Iterable[Any],
        slam: Any,
        passed: dict[str, Float],
        shapes: dict[str, tuple[int, int]],
        names: Roles,
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
        self._places: list[tuple[str, dict[str, Any], str, Float | None]] = []  # role, space, name, value of the file
        for space, role in product(self._spaces, shapes):
            for name, value in space.items():
                if role not in passed and _real(value).shape == shapes[role] and role_of(name, names) == role:
                    self._places.append((role, space, name, np.array(value, float)))
                elif role in passed and space is attributes and np.array_equal(_real(value), passed[role]):
                    self._places.append((role, space, name, None))

    def set(self, role: str, cov: Float) -> None:
        """Set all covariances of a role to the recording's, as far as its noise is assumed."""
        for own_role, space, name, own in self._places:
            if own_role == role and (own is None or self._is_replaced):
                space[name] = cov.copy()

    def is_replaced(self, given: dict[str, Float]) -> bool:
        """Return whether the noise of the recording replaces another one of the file."""
        return self._is_replaced and any(self._compared(given))

    def remarks(self, given: dict[str, Float], ignored: Collection[str] = ()) -> list[str]:
        """Return sentences on the noise of the file: replaced covariances, and others that the file keeps.

        Args:
            given: first covariances of the recording, by role.
            ignored: names of attributes without noise.
        """
        found = self._compared(given)
        read = self._read - {*ignored, *(name for _, _, name, _ in self._places)}
        others = [
            f"{name} = {shown(value)}"
            for space in self._spaces
            for name, value in space.items()
            if name in read and words_of(name) & NOISE_WORDS and 0 < _real(value).size < 10
        ]
        if others:
            has = " and ".join(f"{NAMES[role]} {shown(cov)}" for role, cov in given.items())
            found.append(f"its own noise, {', '.join(others)}, is kept; the recording has {has}")
        return [*filter(None, found)]

    def _compared(self, given: dict[str, Float]) -> list[str]:
        """Return a sentence, or an empty text, for each covariance of the file."""
        return [
            noise_remark(f"{NAMES[role]} {name}", own, given[role], is_replaced=self._is_replaced)
            for role, _, name, own in self._places
            if own is not None
        ]


def _real(value: object) -> Float:
    """Return a number or an array of numbers as an array; an empty one for anything else."""
    is_real = isinstance(value, np.ndarray | float | int) and not isinstance(value, bool)
    array = np.asarray(value) if is_real else np.zeros(0)
    return array if array.dtype.kind in "fiu" else np.zeros(0)
