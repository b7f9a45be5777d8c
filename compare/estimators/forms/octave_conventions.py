"""Conventions of the Octave course's functions in Python: shapes, numbers of landmarks, kinds of arguments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.columns import Column
from slamgauge.se2 import wrap

MU = {"vector": "mu (2N+3,)", "column": "mu (2N+3, 1)", "numbers": "mu (2N+3, 1) with elements as numbers"}
OBSERVED = {
    "array": "observed as an array of bools",
    "ids": "observed as a list of ids",
    "list": "observed as a list of bools",
    "array from 1": "observed as an array of N+1 bools",
    "set": "observed as a set of ids",
    "dict": "observed as a dict of bools",
    "row": "observed as an array (1, N) of bools",
}
OBSERVATIONS = {
    "fields": "z as a list of observations",
    "rows": "z (m, 3) as an array",
    "range first": "z (m, 3) as an array of range, bearing, id",
    "columns": "z (3, m) as an array",
}
U = {"vector": "u (3,)", "column": "u (3, 1)"}


class Turn(Column):
    """An increment as u = (r1, t, r2) [rad, m, rad]; fields are read by position, as `u.r1` and as `u["r1"]`."""

    def __getitem__(self, key: Any) -> Any:
        """Return a field by its name; otherwise index the array."""
        return getattr(self, key) if isinstance(key, str) else super().__getitem__(key)

    @property
    def r1(self) -> float:
        """First turn [rad]."""
        return self.item(0)

    @property
    def t(self) -> float:
        """Distance [m]."""
        return self.item(1)

    @property
    def r2(self) -> float:
        """Second turn [rad]."""
        return self.item(2)


class CourseObservation(NamedTuple):
    """An observation: number of the landmark, range [m], bearing [rad]; `sid` and `landmark_id` are the number, too."""

    id: int
    range: float
    bearing: float

    def __getitem__(self, key: Any) -> Any:
        """Return a field by its position or its name."""
        return getattr(self, key) if isinstance(key, str) else tuple.__getitem__(self, key)

    def __getattr__(self, name: str) -> Any:
        """Return the field whose name is part of another name."""
        for field in () if name.startswith("_") else ("range", "bearing", "id"):
            if field in name.lower():
                return getattr(self, field)
        raise AttributeError(f"no field {name!r}; an observation has id, range and bearing")


class CourseScan(list[CourseObservation]):
    """Observations as a list; a field of all of them is `z["id"]` or `z.id`, an element of their table `z[i, 0]`."""

    def __getitem__(self, key: Any) -> Any:
        """Return an observation, a field of all (m,), or elements of the table (m, 3)."""
        if isinstance(key, str):
            return np.array([each[key] for each in self])
        return np.array(self)[key] if isinstance(key, tuple) else super().__getitem__(key)

    def __getattr__(self, name: str) -> Any:
        """Return a field of all observations (m,), or the shape of their table."""
        if name == "shape":
            return (len(self), len(CourseObservation._fields))
        if name not in CourseObservation._fields:
            raise AttributeError(name)
        return self[name]


class Convention(NamedTuple):
    """How the functions are called; each field is a key of the table in capitals.

    Attributes:
        mu: shape of the state.
        first_id: number of the first landmark, 0 or 1.
        observed: kind of the marks of observed landmarks.
        observations: kind of z.
        u: shape of the increment.
    """

    mu: str
    first_id: int
    observed: str
    observations: str
    u: str

    def words(self) -> str:
        """Return the convention in words."""
        shape = "" if self.u == "vector" else f", {U[self.u]}"
        z, observed = OBSERVATIONS[self.observations], OBSERVED[self.observed]
        return f"{MU[self.mu]}, ids from {self.first_id}, {z}, {observed}{shape}"

    def state(self, values: Float) -> Any:
        """Return the state (2N+3,) in its shape."""
        if self.mu == "vector":
            return values
        return values.reshape(-1, 1) if self.mu == "column" else values.reshape(-1, 1).view(Column)

    def marks(self, count: int, before: Any = None) -> Any:
        """Return the marks of `count` landmarks: those `before`, and further ones that are not observed.

        Marks by id need no room; those of other kinds are followed by `False`.
        """
        if self.observed in ("ids", "set"):
            return before if before is not None else [] if self.observed == "ids" else set()
        if self.observed == "dict":
            return dict.fromkeys(range(self.first_id, self.first_id + count), False) | (before or {})
        if self.observed == "list":
            before = [] if before is None else before
            return [*before, *[False] * (count - len(before))]
        shape = (1, count) if self.observed == "row" else (count + (self.observed == "array from 1"),)
        marks = np.zeros(shape, dtype=bool if before is None else np.asarray(before).dtype)
        if before is not None:
            marks[..., : np.shape(before)[-1]] = before
        return marks

    def scan(self, numbers: Sequence[int], values: Float) -> Any:
        """Return observations of the landmarks `numbers`, counted from 0, with ranges and bearings (m, 2)."""
        z = CourseScan(
            CourseObservation(j + self.first_id, *value) for j, value in zip(numbers, values.tolist(), strict=True)
        )
        table = np.array(z).reshape(-1, 3)
        arrays = {"rows": table, "range first": table[:, [1, 2, 0]], "columns": table.T}
        return arrays.get(self.observations, z)

    def increment(self, odometry: Float) -> Turn:
        """Return the body-frame increment (3,) [m, m, rad] as u."""
        u = turn(odometry)
        return u if self.u == "vector" else u[:, np.newaxis]


def conventions() -> Iterator[Convention]:
    """Yield all conventions, frequent ones first."""
    for mu, first_id, z, observed, u in product(MU, (0, 1), OBSERVATIONS, OBSERVED, U):
        if observed != "array from 1" or first_id == 1:
            yield Convention(mu, first_id, observed, z, u)


def turn(increment: Float) -> Turn:
    """Convert the body-frame increment (3,) [m, m, rad] to two turns and a distance; backwards t is negative."""
    dx, dy, dtheta = increment.tolist()
    sign = -1.0 if dx < 0 else 1.0
    r1 = float(np.arctan2(sign * dy, sign * dx))
    return np.array([r1, sign * float(np.hypot(dx, dy)), float(wrap(dtheta - r1))]).view(Turn)
