"""iSAM2 fed step by step: the factors and first guesses of every update, and the newest pose after it."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from slamgauge.arrays import Float
from slamgauge.graph_baseline.chain import carried_on, keyed
from slamgauge.graph_baseline.factors import (
    LENT_SLIP,
    GraphBuilder,
    first_sights,
    landmarks_at_first_sight,
    read_values,
)
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.triangulation import triangulate


@dataclass(frozen=True)
class Settings:
    """When iSAM2 linearises anew; see `benchmarks/isam2_settings.py` for accuracy against time."""

    relinearize_threshold: float  # m or rad
    relinearize_every: int  # steps


SURE = 0.1  # as in `triangulation`; undamped steps fail from starts as rough as batch can use
SETTLING = 5  # updates that follow at once where bearings have placed a landmark
SETTINGS = Settings(relinearize_threshold=0.05, relinearize_every=10)


class GrowingProblem:
    """iSAM2 and the factors and first guesses that wait for its next update."""

    def __init__(self, recording: Recording, settings: Settings, factorization: str) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization(factorization)
        parameters.setRelinearizeThreshold(settings.relinearize_threshold)
        parameters.relinearizeSkip = settings.relinearize_every
        self.solver = gtsam.ISAM2(parameters)
        self._builder = GraphBuilder(recording, LENT_SLIP)
        self._recording = recording
        self._order = gtsam.KeyGroupMap()  # what is eliminated late (1) and last (2)
        self.known: set[int] = set()
        self._waiting: dict[int, list[int]] = {}  # landmark: rows of the bearings that do not place it yet
        self._placed = False  # whether a landmark has just been placed by bearings
        self._path = np.empty((recording.steps + 1, 3))  # newest pose at each step
        self._newest = 0
        self._guess = gtsam.Pose2(*recording.prior_mean)
        self._heading_at_linearisation = self._guess.theta()
        self._graph = gtsam.NonlinearFactorGraph()
        self._values = gtsam.Values()

    def add_step(self, k: int) -> None:
        """Put the factors of step k, and first guesses of what is new, in the queue."""
        self._builder.add_motion(self._graph, k)
        self._order = gtsam.KeyGroupMap()
        if k > 0:
            self._guess = self._guess.compose(self._builder.increment(k))
            self._order.insert2(X(k - 1), 1)
        self._order.insert2(X(k), 2)
        self._newest = k
        self._values.insert(X(k), self._guess)
        self._heading_at_linearisation = self._guess.theta()
        self._path[k] = self.newest_pose()
        for name, row in self._builder.sights(k):
            if name in self.known or self._place(name, row):
                self._order.insert2(L(name), 1)
                self._graph.add(self._builder.sight_factor(k, row))

    def _place(self, name: int, row: int) -> bool:
        """Insert a landmark at its first sight, or with all its bearings as soon as they place it."""
        recording = self._recording
        if recording.sensor == "bearing":
            waiting = self._waiting.setdefault(name, [])
            rows = np.array([*waiting, row])
            seen_from = self._path[recording.observation_step[rows]]
            bearings, variances = recording.observation[rows, 0], recording.observation_cov[rows, 0, 0]
            found = triangulate(seen_from, bearings, variances, SURE)
            if not found.placed:
                waiting.append(row)
                return False
            for earlier in self._waiting.pop(name):
                self._graph.add(self._builder.sight_factor(int(recording.observation_step[earlier]), earlier))
            self._values.insert(L(name), gtsam.Point2(*found.landmark))
            self._placed = True
        else:
            self._values.insert(L(name), self._guess.transformFrom(self._builder.body_point(row)))
        self.known.add(name)
        return True

    def optimise(self) -> None:
        """Take in what waits; what is seen now is eliminated late, and the newest pose last: its marginal is cheap.

        GTSAM's ordering needs more variables than there are groups; without them it orders by itself.
        """
        order = self._order if self._order.size() > 2 else None
        self.solver.update(self._graph, self._values, [], order)
        if self._placed:
            self._settle(order)
        self._graph.resize(0)
        self._values.clear()
        self._guess = self.solver.calculateEstimatePose2(X(self._newest))
        self._path[self._newest] = self.newest_pose()

    def _settle(self, order: gtsam.KeyGroupMap | None) -> None:
        """Linearise anew until a landmark that was triangulated roughly is where it belongs."""
        for _ in range(SETTLING):
            self.solver.update(
                gtsam.NonlinearFactorGraph(),
                gtsam.Values(),
                [],
                order,
                gtsam.KeyList(),
                gtsam.KeyList(),
                True,  # force_relinearize
            )
        self._placed = False
        self._heading_at_linearisation = self.solver.getLinearizationPoint().atPose2(X(self._newest)).theta()

    def newest_pose(self) -> Float:
        """(3,) x [m], y [m], heading [rad]."""
        return np.array([self._guess.x(), self._guess.y(), self._guess.theta()])

    def newest_pose_cov(self) -> Float:
        """(3, 3) in world coordinates; GTSAM's is in the body frame of the linearisation point.

        A pose's own update linearises it where it was inserted.
        """
        to_world = np.eye(3)
        to_world[:2, :2] = rotation(self._heading_at_linearisation)
        covariance = to_world @ self.solver.marginalCovariance(X(self._newest)) @ to_world.T
        return (covariance + covariance.T) / 2


def causal_values(recording: Recording) -> tuple[Float, Float]:
    """Poses (N+1, 3) and landmarks (L, 2) as iSAM2 has them at the end; for a start.

    Raises:
        RuntimeError: GTSAM found a variable undetermined.
    """
    short, key = keyed(recording)
    growing = GrowingProblem(short, SETTINGS, "QR")
    for k in range(short.steps + 1):
        growing.add_step(k)
        growing.optimise()
    poses, found = read_values(growing.solver.calculateEstimate())
    path = carried_on(recording, key, poses)
    landmarks = landmarks_at_first_sight(recording, path)
    landmarks[np.isin(first_sights(recording)[0], sorted(growing.known))] = found
    return path, landmarks
