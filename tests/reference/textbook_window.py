"""A dense and slow textbook version of the sliding-window filter, with all Jacobians by differences.

Unknowns have names: ("pose", step) and ("landmark", id). The prior of the window is a quadratic function of
right-invariant errors, 1/2 e' information e - gradient' e. Gauss-Newton steps on the residuals of all unknowns solve
the window. Motions need noise in every direction. Errors rotate about the origin, where a recording should start.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slamgauge import sensors
from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, rotation, wrap
from slamgauge.triangulation import triangulate
from tests.reference.jacobians import differentiate

Name = tuple[str, int]
Values = dict[Name, Float]
STEPS = 12  # Gauss-Newton steps
SURE = 0.3  # largest sigma over distance of a landmark that bearings place
FINE = 1e-4  # [m] and [rad] between the points of a difference


class TextbookWindow:
    """The window after some steps of a recording."""

    def __init__(self, recording: Recording, lag: int) -> None:
        self.recording, self.lag = recording, lag
        self.known: list[Name] = [("pose", 0)]  # variables of the prior, beginning with the first pose of the window
        self.at: Values = {("pose", 0): recording.prior_mean}
        self.gradient = np.zeros(3)
        to_errors = np.eye(3)  # additive = D invariant
        to_errors[:2, 2] = -recording.prior_mean[1], recording.prior_mean[0]
        self.information = to_errors.T @ np.linalg.inv(recording.prior_cov) @ to_errors
        self.values: Values = {("pose", 0): recording.prior_mean.copy()}
        self.first = self.step = 0
        self.kept: dict[
            int, list[int]
        ] = {}  # observations of landmarks that were not mapped when their step left the window
        self.placed_at: dict[int, int] = {}

    # --- residuals -------------------------------------------------------------------------------

    def rows(self, step: int) -> list[int]:
        return np.flatnonzero(self.recording.observation_step == step).tolist()

    def name(self, row: int) -> int:
        assert self.recording.landmark is not None
        return int(self.recording.landmark[row])

    def errors(self, values: Values) -> Float:
        return np.concatenate([invariant_error(name, self.known[0], values, self.at) for name in self.known])

    def of_prior(self, values: Values) -> Float:
        squared, vectors = np.linalg.eigh(self.information)
        held = squared > 1e-9 * squared[-1]
        root = np.sqrt(squared[held])[:, None] * vectors[:, held].T
        pull = (vectors[:, held].T @ self.gradient) / np.sqrt(squared[held])
        return root @ self.errors(values) - pull

    def of_motion(self, step: int, values: Values) -> Float:
        noise = between(values["pose", step - 1], values["pose", step]) - self.recording.odometry[step - 1]
        noise[2] = wrap(noise[2])
        return whitened(noise, self.recording.odometry_cov[step - 1])

    def of_sight(self, row: int, values: Values) -> Float:
        pose = values["pose", int(self.recording.observation_step[row])]
        delta = rotation(pose[2]).T @ (values["landmark", self.name(row)] - pose[:2])
        sensor = self.recording.sensor
        v = sensors.innovation(sensor, self.recording.observation[row], sensors.predict(sensor, delta))
        return whitened(v, self.recording.observation_cov[row])

    def of_scan(self, rows: list[int], values: Values) -> list[Float]:
        return [self.of_sight(row, values) for row in rows if self.name(row) in self.placed_at]

    def of_all(self, values: Values) -> Float:
        parts = [self.of_prior(values)]
        parts += [self.of_motion(k, values) for k in range(self.first + 1, self.step + 1)]
        for k in range(self.first, self.step + 1):
            parts += self.of_scan(self.rows(k), values)
        for rows in self.kept.values():
            parts += self.of_scan(rows, values)
        return np.concatenate(parts)

    # --- steps -----------------------------------------------------------------------------------

    def add_step(self) -> tuple[Float, Float]:
        """Process the next step; return the newest pose (3,) and its covariance (3, 3)."""
        if self.step - self.first >= self.lag:
            self.slide()
        self.step += 1
        move = self.recording.odometry[self.step - 1]
        self.values["pose", self.step] = compose(self.values["pose", self.step - 1], move)
        return self.take_in_scan()

    def take_in_scan(self) -> tuple[Float, Float]:
        if self.recording.sensor != "bearing":
            for row in self.rows(self.step):
                if self.name(row) not in self.placed_at:
                    z, pose = self.recording.observation[row], self.values["pose", self.step]
                    delta = sensors.inverse(self.recording.sensor, z)
                    self.place(self.name(row), pose[:2] + rotation(pose[2]) @ delta)
            return self.solve()
        self.solve()
        for row in self.rows(self.step):
            name = self.name(row)
            in_window = [r for k in range(self.first, self.step + 1) for r in self.rows(k) if self.name(r) == name]
            before = [r for rows in self.kept.values() for r in rows if self.name(r) == name]
            for rows in (in_window, before + in_window) if before else (in_window,):
                if name not in self.placed_at and len(rows) >= 3:
                    steps = self.recording.observation_step[rows].tolist()
                    poses = np.array([self.values["pose", k] for k in steps])
                    z, R = self.recording.observation[rows, 0], self.recording.observation_cov[rows, 0, 0]
                    found = triangulate(poses, z, R, SURE)
                    if found.placed:
                        self.place(name, found.landmark)
        return self.solve()

    def place(self, name: int, place: Float) -> None:
        self.placed_at[name] = self.step
        self.values["landmark", name] = place

    def solve(self) -> tuple[Float, Float]:
        names = [*self.values]
        A = np.zeros((0, 0))
        for _ in range(STEPS):
            A, b = normal_equations(self.of_all, self.values, names)
            self.values = stepped(self.values, names, np.asarray(np.linalg.solve(A, b), np.float64))
            self.rebase()
        column = sum(len(self.values[name]) for name in names[: names.index(("pose", self.step))])
        covs = np.asarray(np.linalg.inv(A), np.float64)
        return self.values["pose", self.step], covs[column : column + 3, column : column + 3]

    # --- marginalisation ---------------------------------------------------------------------------

    def slide(self) -> None:
        for step, rows in [*self.kept.items()]:
            if all(self.placed_at.get(self.name(row), self.first) < self.first for row in rows):
                self.let_go(step)
        waiting = [row for row in self.rows(self.first) if self.name(row) not in self.placed_at]
        gone, second = ("pose", self.first), ("pose", self.first + 1)
        rest = [name for name in self.values if name[0] == "landmark" or name[1] in self.kept]

        def residual(values: Values) -> Float:
            parts = [self.of_prior(values), self.of_motion(self.first + 1, values)]
            return np.concatenate(parts + self.of_scan(self.rows(self.first), values))

        if waiting:
            self.kept[self.first] = waiting
            self.condense(residual, [second, *rest, gone], [])
        else:
            self.condense(residual, [second, *rest], [gone])
        self.first += 1
        if len(self.kept) > self.lag / 2:
            self.let_go(min(self.kept))

    def let_go(self, step: int) -> None:
        rows, gone = self.kept.pop(step), ("pose", step)

        def residual(values: Values) -> Float:
            return np.concatenate([self.of_prior(values), *self.of_scan(rows, values)])

        stay = [("pose", self.first), *(name for name in self.values if name[0] == "landmark" or name[1] in self.kept)]
        self.condense(residual, stay, [gone])

    def rebase(self) -> None:
        """Make the present values the origin of errors."""
        self.gradient = self.gradient - self.information @ self.errors(self.values)
        self.at = {name: self.values[name].copy() for name in self.known}

    def condense(self, residual: Callable[[Values], Float], stay: list[Name], gone: list[Name]) -> None:
        """Make a prior on `stay` from residuals of `stay` and `gone`, and eliminate `gone`."""
        A, b = normal_equations(residual, self.values, [*stay, *gone])
        size = sum(len(self.values[name]) for name in stay)
        if gone:
            answer = np.linalg.solve(A[size:, size:], np.column_stack([A[size:, :size], b[size:]]))
            A, b = A[:size, :size] - A[:size, size:] @ answer[:, :-1], b[:size] - A[:size, size:] @ answer[:, -1]
        self.known, self.at = stay, {name: self.values[name].copy() for name in stay}
        to_errors = np.linalg.inv(differentiate_named(self.errors, self.values, stay))
        self.information, self.gradient = to_errors.T @ A @ to_errors, to_errors.T @ b
        for name in gone:
            del self.values[name]


def invariant_error(name: Name, first: Name, values: Values, at: Values) -> Float:
    """Return the right-invariant error of a point or a pose; the first pose gives the rotation."""
    turn = float(wrap(values[first][2] - at[first][2]))
    moved = values[name][:2] - rotation(turn) @ at[name][:2]
    error = np.asarray(np.linalg.solve(mean_turn(turn), moved), np.float64)
    if len(values[name]) == 3:
        error = np.append(error, turn if name == first else wrap(values[name][2] - at[name][2] - turn))
    return error


def mean_turn(turn: float) -> Float:
    """Return V(turn), the mean of rotations from 0 to `turn`."""
    a, b = (np.sin(turn) / turn, (1.0 - np.cos(turn)) / turn) if abs(turn) > 1e-6 else (1.0, 0.5 * turn)
    return np.array([[a, -b], [b, a]])


def whitened(v: Float, cov: Float) -> Float:
    return np.asarray(np.linalg.solve(np.linalg.cholesky(cov), v), np.float64)


def stepped(values: Values, names: list[Name], step: Float) -> Values:
    """Return the values after a step of the named ones."""
    moved, at = {**values}, 0
    for name in names:
        size = len(values[name])
        moved[name] = values[name] + step[at : at + size]
        if size == 3:
            moved[name][2] = wrap(moved[name][2])
        at += size
    return moved


def differentiate_named(function: Callable[[Values], Float], values: Values, names: list[Name]) -> Float:
    size = sum(len(values[name]) for name in names)
    return differentiate(lambda step: function(stepped(values, names, step)), np.zeros(size), FINE)


def normal_equations(residual: Callable[[Values], Float], values: Values, names: list[Name]) -> tuple[Float, Float]:
    J = differentiate_named(residual, values, names)
    return J.T @ J, -J.T @ residual(values)


def textbook_sliding_window(recording: Recording, lag: int) -> Estimate:
    """Do the same as `slamgauge.ekf.sliding_window`."""
    window, steps = TextbookWindow(recording, lag), recording.steps
    poses, covs = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3))
    poses[0], covs[0] = window.take_in_scan()
    for k in range(1, steps + 1):
        poses[k], covs[k] = window.add_step()
    landmarks = np.array([window.values["landmark", name] for name in window.placed_at]).reshape(-1, 2)
    return Estimate(
        kind="filtered", poses=poses, pose_covs=covs, landmark_ids=np.array([*window.placed_at]), landmarks=landmarks
    )
