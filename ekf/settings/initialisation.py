"""How landmarks begin where the sensor gives bearings alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slamgauge.arrays import Float
from slamgauge.errors import UserError

Sharing = Literal["federated", "uniform", "none", "best", "weights"]

FEWEST = 3  # bearings that place a landmark


@dataclass(frozen=True)
class Rays:
    """How rays are made, weighed and shared out.

    Attributes:
        alpha: a member's standard deviation over its distance, below 1.
        beta: distance of a member over that of the one before, above 1.
        s_min: nearest distance of a landmark [m].
        s_max: farthest distance of a landmark [m]; no shorter than the sensor's range.
        threshold: tau; members with a weight below tau / (number of members at first) go.
        gate: largest squared Mahalanobis distance (1 degree of freedom) of the nearest member.
        lost_after: a ray whose every member fails the gate so many times in a row is deleted.
        sharing: `federated`; the others are there to see what it is worth: `uniform` shares, `none` (R to every
            member), `best` (R to the heaviest alone), `weights` (no corrections before the ray is a point).
    """

    alpha: float = 0.3
    beta: float = 2.0
    s_min: float = 1.0
    s_max: float = 10.0
    threshold: float = 1e-3
    gate: float = 9.0
    lost_after: int = 3
    sharing: Sharing = "federated"

    def __post_init__(self) -> None:
        rules = (
            (0.0 < self.alpha < 1.0, f"alpha: {self.alpha} is no share of a distance; choose it above 0 and below 1"),
            (self.beta > 1.0, f"beta: {self.beta} makes no progression; choose it above 1"),
            (
                0.0 < self.s_min < self.s_max < math.inf,
                f"s_max: {self.s_max} m must be finite and lie beyond s_min, {self.s_min} m, above 0",
            ),
            (0.0 < self.threshold < 1.0, f"threshold: {self.threshold} prunes all or nothing; choose it in (0, 1)"),
            (self.gate > 0.0, f"gate: {self.gate} lets nothing pass; choose it above 0"),
            (self.lost_after >= 1, f"lost_after: {self.lost_after} loses a ray by no failure; choose at least 1"),
        )
        for holds, mistake in rules:
            if not holds:
                raise UserError(mistake)

    def distances(self) -> Float:
        """Distances (N_g,) of the members [m]."""
        ratio = (1.0 - self.alpha) / (1.0 + self.alpha) * self.s_max / self.s_min
        count = max(1 + math.ceil(math.log(ratio) / math.log(self.beta)), 1)
        return self.s_min / (1.0 - self.alpha) * np.float64(self.beta) ** np.arange(count)


@dataclass(frozen=True)
class InverseDepth:
    """What is expected of a new landmark, and when it becomes a point.

    The defaults suit a sensor that reaches 10 m: in general 1.5 / reach and 0.5 / reach, so that two standard
    deviations hold 0.4 to 2 times the reach, at which most landmarks come into view.

    Attributes:
        mean: inverse distance of a new landmark [1/m].
        sigma: its standard deviation [1/m].
        linearity: index below which a landmark becomes a point.
        gate: largest squared Mahalanobis distance of a bearing (1 degree of freedom).
        lost_after: a landmark whose bearing fails the gate so many times in a row is deleted.
    """

    mean: float = 0.15
    sigma: float = 0.05
    linearity: float = 0.1
    gate: float = 9.0
    lost_after: int = 3

    def __post_init__(self) -> None:
        rules = (
            (self.mean > 0.0, f"mean: {self.mean} 1/m is no inverse distance; choose it above 0"),
            (self.sigma > 0.0, f"sigma: {self.sigma} 1/m leaves nothing to find out; choose it above 0"),
            (self.linearity > 0.0, f"linearity: {self.linearity} is never reached; choose it above 0"),
            (self.gate > 0.0, f"gate: {self.gate} lets nothing pass; choose it above 0"),
            (self.lost_after >= 1, f"lost_after: {self.lost_after} loses a landmark by no failure; choose at least 1"),
        )
        for holds, mistake in rules:
            if not holds:
                raise UserError(mistake)


@dataclass(frozen=True)
class Delayed:
    """How long a landmark waits.

    Attributes:
        poses: how many the window holds at most.
        spacing: way between them [m]; a fiftieth of the sensor's reach serves well.
        sure: largest standard deviation of a landmark that is placed, as a share of its distance.
    """

    poses: int = 30
    spacing: float = 0.2
    sure: float = 0.1

    def __post_init__(self) -> None:
        rules = (
            (self.poses >= FEWEST, f"poses: {self.poses} place no landmark; choose at least {FEWEST}"),
            (self.spacing >= 0.0, f"spacing: {self.spacing} m is no way; choose it at least 0"),
            (self.sure > 0.0, f"sure: {self.sure} is never reached; choose it above 0"),
        )
        for holds, mistake in rules:
            if not holds:
                raise UserError(mistake)


Initialisation = Rays | InverseDepth | Delayed
