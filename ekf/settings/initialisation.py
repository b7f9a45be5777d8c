"""How landmarks begin where the sensor gives bearings alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from slamgauge.ekf.settings.validation import check, gate_setting, setting
from slamgauge.errors import UserError

Sharing = Literal["federated", "uniform", "none", "best", "weights"]

MOST_MEMBERS = 1000  # of a ray; the practical's has three
FEWEST = 3  # bearings that place a landmark


@dataclass(frozen=True)
class Rays:
    """How rays are made, weighed and shared out.

    The defaults suit a sensor that reaches 10 m: in general members from 0.3 of the reach on. Most landmarks come into
    view at the reach, and a member close by costs most (`docs/bearings.md`, *Where members should lie*).

    Attributes:
        alpha: a member's standard deviation over its distance, below 1.
        beta: distance of a member over that of the one before, above 1.
        s_min: nearest distance of a landmark [m], by which members begin.
        s_max: farthest distance of a landmark [m]; no shorter than the sensor's range, which it is by default.
        threshold: tau; members with a weight below tau / (number of members at first) go.
        gate: largest squared Mahalanobis distance (1 degree of freedom) of the nearest member.
        lost_after: scans in a row in which no member passes the gate, after which a ray is deleted.
        sharing: `federated`; the others are there to see what it is worth: `uniform` shares, `none` (R to every
            member), `best` (R to the heaviest alone), `weights` (no corrections before the ray is a point).
    """

    alpha: float = setting(0.25, lambda a: 0.0 < a < 1.0, "{} is no share of a distance; choose it above 0 and below 1")
    beta: float = setting(1.7, lambda b: b > 1.0, "{} makes no progression; choose it above 1")
    s_min: float = setting(3.0, lambda s: s > 0.0, "{} m is no distance; choose it above 0", lambda reach: 0.3 * reach)
    s_max: float = setting(10.0, lambda s: s > 0.0, "{} m is no distance; choose it above 0", lambda reach: reach)
    threshold: float = setting(1e-3, lambda t: 0.0 < t < 1.0, "{} prunes all or nothing; choose it in (0, 1)")
    gate: float = gate_setting()
    lost_after: int = setting(3, lambda n: n >= 1, "{} loses a ray by no failure; choose at least 1")
    sharing: Sharing = "federated"

    def __post_init__(self) -> None:
        check(self)
        if not self.s_min < self.s_max:
            raise UserError(f"s_max: {self.s_max} m must lie beyond s_min, {self.s_min} m; choose it farther")
        if self.member_count > MOST_MEMBERS:
            what = f"{self.beta} makes {self.member_count} members of a ray from s_min to s_max"
            raise UserError(f"beta: {what}; choose it larger, for {MOST_MEMBERS} members at most")

    @property
    def member_count(self) -> int:
        """Number N_g of members of a new ray (see `bearings.rays`)."""
        orders = math.log((1.0 - self.alpha) / (1.0 + self.alpha)) + math.log(self.s_max) - math.log(self.s_min)
        return max(1 + math.ceil(orders / math.log(self.beta)), 1)


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
        lost_after: bearings in a row that fail the gate, after which a landmark is deleted.
    """

    mean: float = setting(
        0.15, lambda m: m > 0.0, "{} 1/m is no inverse distance; choose it above 0", lambda reach: 1.5 / reach
    )
    sigma: float = setting(
        0.05, lambda s: s > 0.0, "{} 1/m leaves nothing to find out; choose it above 0", lambda reach: 0.5 / reach
    )
    linearity: float = setting(0.1, lambda x: x > 0.0, "{} is never reached; choose it above 0")
    gate: float = gate_setting()
    lost_after: int = setting(3, lambda n: n >= 1, "{} loses a landmark by no failure; choose at least 1")

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Delayed:
    """How long a landmark waits.

    Attributes:
        poses: how many the window holds at most.
        spacing: way between them [m]; a fiftieth of the sensor's reach serves well.
        sure: largest standard deviation of a landmark that is placed, as a share of its distance.
    """

    poses: int = setting(30, lambda n: n >= FEWEST, f"{{}} place no landmark; choose at least {FEWEST}")
    spacing: float = setting(
        0.2, lambda s: s >= 0.0, "{} m is no way; choose it at least 0", lambda reach: reach / 50.0
    )
    sure: float = setting(0.1, lambda s: s > 0.0, "{} is never reached; choose it above 0")

    def __post_init__(self) -> None:
        check(self)


Initialisation = Rays | InverseDepth | Delayed
