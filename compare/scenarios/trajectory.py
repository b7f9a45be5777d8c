"""The path that the robot follows, in the kinds in which a scenario file can give it.

Every kind has `step` [s]; for a start, the prior's mean, `increments` (N, 3) of the body frame and `stamps` (N+1,) [s].
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.csv_tables import Table
from slamgauge.compare.scenarios.section import Positive, Section
from slamgauge.compare.scenarios.settings_sections import Number, Whole
from slamgauge.errors import UserError
from slamgauge.se2 import between, wrap

PATH_HEADER = ("stamp", "x", "y", "theta")
Pose = tuple[float, float, float]  # x, y [m], heading [rad]
Moves = Iterable[tuple[tuple[float, float], int]]  # speed [m/s] and yaw rate [rad/s], and for how many steps

_MAX_STEPS = 1_000_000  # a misplaced decimal point shall not fill the memory


class Segment(Section):
    """A stretch driven at constant `speed` [m/s] and `yaw_rate` [rad/s] for `duration` [s]."""

    speed: Number
    yaw_rate: Number
    duration: Positive


class Steady(Section, ABC):
    """What the kinds with time steps of equal length `step` [s] have in common."""

    step: Positive

    @abstractmethod
    def moves(self, start: Pose, /) -> Moves:
        """How the robot is driven from a pose on."""

    def increments(self, start: Pose, /) -> Float:
        """Body-frame increments (N, 3) [m, m, rad].

        Raises:
            UserError: there would be too many.
        """
        moves = [*self.moves(start)]
        steps = [times for _, times in moves]
        if sum(steps) > _MAX_STEPS:
            raise UserError(f"trajectory: {sum(steps)} steps are more than {_MAX_STEPS}; raise step or speed")
        rates = np.array([(speed, 0.0, yaw_rate) for (speed, yaw_rate), _ in moves])
        return np.repeat(rates * self.step, steps, axis=0)

    def stamps(self, start: Pose, /) -> Float:
        """Times (N+1,) of the poses [s]."""
        steps = sum(times for _, times in self.moves(start))
        return np.arange(steps + 1, dtype=np.float64) * self.step

    def durations(self) -> Float:
        """How long a step takes, () [s]."""
        return np.array(self.step)

    def even(self, way: float, turn: float, duration: float) -> tuple[tuple[float, float], int]:
        """A move of just this way [m] and turn [rad], in the fewest whole steps that take the duration [s] at least."""
        steps = max(1, math.ceil(duration / self.step - 1e-9))  # 0.3 / 0.1 is a little above 3
        return (way / (steps * self.step), turn / (steps * self.step)), steps


class Segments(Steady):
    """Segments driven one after the other.

    A file may give speed, yaw_rate and duration in place of a single segment.
    """

    kind: Literal["segments"] = "segments"
    segments: tuple[Segment, ...]

    @model_validator(mode="before")
    @classmethod
    def _single_segment(cls, table: object) -> object:
        if not isinstance(table, dict) or "segments" in table:
            return table
        segment = {key: value for key, value in table.items() if key in Segment.model_fields}
        rest = {key: value for key, value in table.items() if key not in Segment.model_fields}
        return {**rest, "segments": [segment]} if segment else rest

    @model_validator(mode="after")
    def _of_sane_length(self) -> Segments:
        if not self.segments:
            raise PydanticCustomError("too_short", "has no segment; add one")
        if sum(segment.duration for segment in self.segments) / self.step > _MAX_STEPS:
            text = "duration / step comes to more than {most} steps; raise step or shorten duration"
            raise PydanticCustomError("too_long", text, {"most": _MAX_STEPS})
        return self

    @property
    def steps(self) -> tuple[int, ...]:
        """Number of steps of each segment: its duration to the nearest step, at least one."""
        return tuple(max(1, round(segment.duration / self.step)) for segment in self.segments)

    def moves(self, _start: Pose, /) -> Moves:
        """A move for each segment."""
        for segment, steps in zip(self.segments, self.steps, strict=True):
            yield (segment.speed, segment.yaw_rate), steps


class Waypoints(Steady):
    """From the start to each of the `points` (x, y) [m] in turn: a turn on the spot towards it, then straight on.

    The robot drives no faster than `speed` [m/s] and turns no faster than `yaw_rate` [rad/s]; both are lowered so that
    every stretch takes a whole number of steps, and ends on its point.
    """

    kind: Literal["waypoints"]
    points: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1)]
    speed: Positive
    yaw_rate: Positive

    def moves(self, start: Pose, /) -> Moves:
        """A turn and a straight stretch for each point; none where there is nothing to turn, or to drive."""
        x, y, heading = start
        for to_x, to_y in self.points:
            way = math.hypot(to_x - x, to_y - y)
            towards = math.atan2(to_y - y, to_x - x) if way else heading
            turn = float(wrap(towards - heading))
            if turn:
                yield self.even(0.0, turn, abs(turn) / self.yaw_rate)
            if way:
                yield self.even(way, 0.0, way / self.speed)
            x, y, heading = to_x, to_y, towards


class FigureEight(Steady):
    """A circle of `radius` [m] to the left and one to the right, `laps` times, at `speed` [m/s] or a little less.

    The circles touch where the robot starts, and it comes through there heading as it began.
    """

    kind: Literal["figure-eight"]
    radius: Positive
    speed: Positive
    laps: Annotated[Whole, Field(ge=1)] = 1

    def moves(self, _start: Pose, /) -> Moves:
        """A circle, and the other."""
        way = 2.0 * math.pi * self.radius
        for turn in (2.0 * math.pi, -2.0 * math.pi) * self.laps:
            yield self.even(way, turn, way / self.speed)


class Csv(Section):
    """Poses of a `file`: a row `stamp,x,y,theta` [s, m, m, rad] in the world frame for each, the first at the start."""

    kind: Literal["csv"]
    file: Table

    @model_validator(mode="after")
    def _is_a_path(self) -> Csv:
        rows = self.file.rows(PATH_HEADER)
        if not 2 <= len(rows) <= _MAX_STEPS + 1:
            text = "file.{name}: {rows} poses; give 2 to {most}"
            raise PydanticCustomError("path", text, {"name": self.file.name, "rows": len(rows), "most": _MAX_STEPS + 1})
        late = np.flatnonzero(np.diff(rows[:, 0]) <= 0)
        if len(late):
            text = "file: {name}, line {line}: stamps must increase; sort the rows"
            raise PydanticCustomError("path", text, {"name": self.file.name, "line": int(late[0]) + 3})
        return self

    @property
    def poses(self) -> Float:
        """(N+1, 3) in the world frame."""
        return self.file.rows(PATH_HEADER)[:, 1:]

    @property
    def step(self) -> float:
        """Mean time step [s]."""
        return float(np.diff(self.file.rows(PATH_HEADER)[[0, -1], 0])[0] / (len(self.poses) - 1))

    def increments(self, _start: Pose, /) -> Float:
        """Body-frame increments (N, 3) [m, m, rad] between the poses."""
        return between(self.poses[:-1], self.poses[1:])

    def durations(self) -> Float:
        """How long each step takes, (N, 1) [s]."""
        return np.diff(self.file.rows(PATH_HEADER)[:, 0])[:, None]

    def stamps(self, _start: Pose, /) -> Float:
        """Times (N+1,) of the poses [s]."""
        return self.file.rows(PATH_HEADER)[:, 0]


KINDS = {"segments": Segments, "waypoints": Waypoints, "figure-eight": FigureEight, "csv": Csv}


def kind_of(table: object) -> object:
    """The kind of a trajectory, or of the table that a file gives for one."""
    if isinstance(table, dict):
        return table.get("kind", "segments")
    return getattr(table, "kind", "segments")


Trajectory = Annotated[
    Annotated[Segments, Tag("segments")]
    | Annotated[Waypoints, Tag("waypoints")]
    | Annotated[FigureEight, Tag("figure-eight")]
    | Annotated[Csv, Tag("csv")],
    Discriminator(
        kind_of,
        custom_error_type="kind",
        custom_error_message=f"kind is not known; use one of {', '.join(KINDS)}",
    ),
]
