"""The robot's true path. A scenario file chooses one of four kinds: segments, waypoints, figure-eight or csv.

Every kind has the time step `step` [s], and the `durations` of its steps, () or (N, 1) [s]. It computes `increments`
(N, 3) in the body frame [m, m, rad] and `stamps` (N+1,) [s] from the start pose, which is the mean of the prior.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.section import Number, Positive, Section, Table, Whole, invalid
from slamgauge.errors import UserError
from slamgauge.notices import tell_once
from slamgauge.se2 import between, wrap

PATH_HEADER = ("stamp", "x", "y", "theta")
Pose = tuple[float, float, float]  # x, y [m], heading [rad]
Move = tuple[float, float, int]  # speed [m/s], yaw rate [rad/s], number of steps

_SAME_TIME = 1e-6  # steps: smaller differences of a duration from whole steps are rounding
_MAX_STEPS = 1_000_000  # a misplaced decimal point must not fill the memory


class Segment(Section):
    """A part of the path with constant `speed` [m/s] and `yaw_rate` [rad/s] for `duration` [s]."""

    speed: Number
    yaw_rate: Number
    duration: Positive


class Steady(Section, ABC):
    """Base class of the kinds in which all time steps have the length `step` [s]."""

    step: Positive

    @abstractmethod
    def moves(self, start: Pose, /) -> Iterable[Move]:
        """Return the moves of the robot from a start pose; a move has constant speed and yaw rate."""

    def increments(self, start: Pose, /) -> Float:
        """Return body-frame increments (N, 3) [m, m, rad]; raise `UserError` if they are more than _MAX_STEPS."""
        moves = np.array([*self.moves(start)]).reshape(-1, 3)
        steps = moves[:, 2].astype(np.int64)
        if steps.sum() > _MAX_STEPS:
            raise UserError(f"trajectory: {steps.sum()} steps are more than {_MAX_STEPS}; raise step or speed")
        rates = np.column_stack([moves[:, 0], np.zeros(len(moves)), moves[:, 1]])
        return np.repeat(rates * self.step, steps, axis=0)

    def stamps(self, start: Pose, /) -> Float:
        """Return the times (N+1,) of the poses [s]."""
        return np.arange(sum(steps for _, _, steps in self.moves(start)) + 1, dtype=np.float64) * self.step

    @property
    def durations(self) -> Float:
        """Duration of a step, () [s], which is the same for all steps."""
        return np.array(self.step)

    def even(self, way: float, turn: float, duration: float) -> Move:
        """Return a move of distance `way` [m] and turn [rad]: the fewest steps that last at least `duration` [s]."""
        steps = max(1, math.ceil(duration / self.step - 1e-9))  # 0.3 / 0.1 is a little above 3
        return way / (steps * self.step), turn / (steps * self.step), steps


class Segments(Steady):
    """Segments in sequence.

    If the path has a single segment, a file may give its speed, yaw_rate and duration without `segments`.
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
    def _has_sane_length(self) -> Segments:
        if not self.segments:
            raise invalid("has no segment; add one")
        if sum(segment.duration for segment in self.segments) / self.step > _MAX_STEPS:
            raise invalid(f"duration / step comes to more than {_MAX_STEPS} steps; raise step or shorten duration")
        for segment, steps in zip(self.segments, self.steps, strict=True):
            if abs(steps - segment.duration / self.step) > _SAME_TIME:
                rounded = f"whole steps, {steps} x {self.step:g} s = {steps * self.step:g} s"
                tell_once(f"trajectory: the duration of {segment.duration:g} s is rounded to {rounded}")
        return self

    @property
    def steps(self) -> tuple[int, ...]:
        """Number of steps of each segment: its duration divided by `step`, rounded, at least 1."""
        return tuple(max(1, round(segment.duration / self.step)) for segment in self.segments)

    def moves(self, _start: Pose, /) -> Iterable[Move]:
        """Return a move for each segment."""
        moves = zip(self.segments, self.steps, strict=True)
        return ((segment.speed, segment.yaw_rate, steps) for segment, steps in moves)


class Waypoints(Steady):
    """A path through the `points` (x, y) [m], world frame, in their order.

    The robot turns on the spot towards a point, then drives to it in a straight line. Its speed is at most `speed`
    [m/s], and its yaw rate at most `yaw_rate` [rad/s]. Each move has the largest such rate with which it takes a whole
    number of steps.
    """

    kind: Literal["waypoints"]
    points: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1)]
    speed: Positive
    yaw_rate: Positive

    def moves(self, start: Pose, /) -> Iterable[Move]:
        """Return a turn and a straight line for each point, without moves of length 0."""
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
        if all(point == start[:2] for point in self.points):
            raise UserError("trajectory.points: all are at the start, so that the robot does not move; add another one")


class FigureEight(Steady):
    """A circle of `radius` [m] to the left, then one to the right, `laps` times, at `speed` [m/s] or slightly less.

    The circles touch at the start, where the robot always has its initial heading.
    """

    kind: Literal["figure-eight"]
    radius: Positive
    speed: Positive
    laps: Annotated[Whole, Field(ge=1)] = 1

    def moves(self, _start: Pose, /) -> Iterable[Move]:
        """Return a move for each circle."""
        way = 2.0 * math.pi * self.radius
        for turn in (2.0 * math.pi, -2.0 * math.pi) * self.laps:
            yield self.even(way, turn, way / self.speed)


class Csv(Section):
    """Poses of a `file`: rows `stamp,x,y,theta` [s, m, m, rad] in the world frame; the first row is the start."""

    kind: Literal["csv"]
    file: Table

    @model_validator(mode="after")
    def _is_a_path(self) -> Csv:
        rows = self.file.rows(PATH_HEADER)
        if not 2 <= len(rows) <= _MAX_STEPS + 1:
            raise invalid(f"file.{self.file.name}: {len(rows)} poses; give 2 to {_MAX_STEPS + 1}")
        late = np.flatnonzero(np.diff(rows[:, 0]) <= 0)
        if len(late):
            raise invalid(f"file: {self.file.name}, line {int(late[0]) + 3}: stamps must increase; sort the rows")
        return self

    @property
    def poses(self) -> Float:
        """Poses (N+1, 3) [m, m, rad] in the world frame."""
        return self.file.rows(PATH_HEADER)[:, 1:]

    @property
    def durations(self) -> Float:
        """Duration of each step, (N, 1) [s]."""
        return np.diff(self.file.rows(PATH_HEADER)[:, :1], axis=0)

    @property
    def step(self) -> float:
        """Mean time step [s]."""
        stamps = self.file.rows(PATH_HEADER)[:, 0]
        return float((stamps[-1] - stamps[0]) / (len(stamps) - 1))

    def increments(self, _start: Pose, /) -> Float:
        """Return body-frame increments (N, 3) [m, m, rad] between the poses."""
        return between(self.poses[:-1], self.poses[1:])

    def stamps(self, _start: Pose, /) -> Float:
        """Return the times (N+1,) of the poses [s]."""
        return self.file.rows(PATH_HEADER)[:, 0]


KINDS = {"segments": Segments, "waypoints": Waypoints, "figure-eight": FigureEight, "csv": Csv}


def kind_of(table: object) -> object:
    """Return the name of the kind of a trajectory, or of the table of a scenario file that describes it."""
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
        custom_error_message="{message}",
        custom_error_context={"message": f"kind is not known; use one of {', '.join(KINDS)}"},
    ),
]
