"""Settings of the filters; `setting_rules` checks their values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, cast

from slamgauge.ekf.setting_rules import check, setting
from slamgauge.errors import UserError

Method = Literal["nearest-neighbour", "jcbb"]

MOST_MEMBERS = 1000  # members of a ray; a ray of the exercise has three
FEWEST = 3  # bearings that place a landmark by delayed initialisation


@dataclass(frozen=True)
class MapManagement:
    """When a track becomes a landmark, and when two landmarks are merged.

    Attributes:
        sights: observations that confirm a new track.
        probation: scans after which an unconfirmed track is deleted, including the scan of its birth.
        new_gate: an observation within this squared Mahalanobis distance of a landmark that the scan does not observe
            otherwise may be an outlier of that landmark, and starts no track. One correct observation in a million
            exceeds the default (chi-square, 2 degrees of freedom).
        merge_gate: two landmarks that no scan has observed together may be the same if the squared Mahalanobis distance
            of their difference from zero is below this (one duplicate in a million exceeds the default). They are
            merged if neither has another such partner.
    """

    sights: int = setting(5, at_least=1)
    probation: int = setting(10, at_least=1)
    new_gate: float = setting(27.6, at_least=0)
    merge_gate: float = setting(27.6, at_least=0)

    def __post_init__(self) -> None:
        check(self)
        if self.sights > self.probation:
            scans = f"{self.probation} scans of probation"
            raise UserError(f"sights: {self.sights} do not fit into {scans}; choose at most {self.probation}")


@dataclass(frozen=True)
class Association:
    """How observations without ids are associated.

    Attributes:
        method: `nearest-neighbour` or `jcbb`.
        gate: largest squared Mahalanobis distance of a pair. For k pairs together, `jcbb` uses the quantile of the
            chi-square distribution with 2k degrees of freedom that has the same probability.
        map_management: probation, deletion and merging of landmarks; None as in the exercise.
        node_limit: largest number of pairs that `jcbb` tries in a scan. At the limit it returns the best association so
            far, which is at least the jointly compatible nearest neighbours.
    """

    method: Method = "nearest-neighbour"
    gate: float = setting(9.0, above=0)
    map_management: MapManagement | None = None
    node_limit: int = setting(20_000, at_least=1)

    def __post_init__(self) -> None:
        check(self)
        managed = cast("object", self.map_management)
        if not (managed is None or isinstance(managed, MapManagement)):
            raise UserError(f"map_management: {managed!r} is not MapManagement; give MapManagement() or None")


@dataclass(frozen=True)
class Rays:
    """Members and weights of rays (`bearings.rays`).

    The defaults are for a sensor that reaches 10 m: members from 0.3 of the reach on. Most landmarks come into view at
    the reach, and near members cost the most accuracy (`docs/bearings.md`, *Where members should lie*).

    Attributes:
        alpha: standard deviation of a member divided by its distance.
        beta: distance of a member divided by that of the member before.
        s_min: nearest distance of a landmark [m], where the members begin.
        s_max: farthest distance of a landmark [m]: at least the sensor's range, which is the default.
        threshold: tau; members with a weight below tau / (number of members at first) are removed.
        gate: largest squared Mahalanobis distance (1 degree of freedom) of the nearest member.
        lost_after: scans in a row in which no member passes the gate, after which a ray is deleted.
    """

    alpha: float = setting(0.25, above=0, below=1)
    beta: float = setting(1.7, above=1)
    s_min: float = setting(3.0, lambda reach: 0.3 * reach, above=0)
    s_max: float = setting(10.0, lambda reach: reach, above=0)
    threshold: float = setting(1e-3, above=0, below=1)
    gate: float = setting(9.0, above=0)
    lost_after: int = setting(3, at_least=1)

    def __post_init__(self) -> None:
        check(self)
        if not self.s_min < self.s_max:
            raise UserError(f"s_max: {self.s_max} m must be beyond s_min, {self.s_min} m; choose it larger")
        if self.member_count > MOST_MEMBERS:
            what = f"{self.beta} gives {self.member_count} members from s_min to s_max"
            raise UserError(f"beta: {what}; choose it larger, for {MOST_MEMBERS} members at most")

    @property
    def member_count(self) -> int:
        """Number N_g of members of a new ray (see `bearings.rays`)."""
        orders = math.log((1.0 - self.alpha) / (1.0 + self.alpha)) + math.log(self.s_max) - math.log(self.s_min)
        return max(1 + math.ceil(orders / math.log(self.beta)), 1)


@dataclass(frozen=True)
class Delayed:
    """Window of poses from which landmarks are triangulated (`bearings.delayed`).

    Attributes:
        poses: largest number of poses in the window.
        spacing: distance between them [m]; by default a fiftieth of the sensor's reach. Bearings between them are used.
        sure: largest standard deviation of a landmark when it is placed, as a share of its distance.
    """

    poses: int = setting(30, at_least=FEWEST)
    spacing: float = setting(0.2, lambda reach: reach / 50.0, at_least=0)
    sure: float = setting(0.1, above=0)

    def __post_init__(self) -> None:
        check(self)


Initialisation = Rays | Delayed


@dataclass(frozen=True)
class Robustness:
    """How a filter guards its updates against outliers of mapped landmarks.

    Attributes:
        robust: `none`; `gate` rejects observations with ids beyond `gate` (without ids the gate of the association does
            that); `student-t` reduces the weight of far observations, as if their noise had Student's distribution (see
            `kernels.student_t`), with and without ids.
        gate: largest squared Mahalanobis distance of a single observation. One correct observation in a thousand
            exceeds the default (chi-square, 2 degrees of freedom).
        degrees_of_freedom: of Student's distribution; the fewer, the heavier its tails (1 is Cauchy's).
    """

    robust: Literal["none", "gate", "student-t"] = "none"
    gate: float = setting(13.8, above=0)
    degrees_of_freedom: float = setting(1.0, above=0)

    def __post_init__(self) -> None:
        check(self)

    @property
    def known_gate(self) -> float | None:
        """Gate for observations with ids; None without a gate."""
        return self.gate if self.robust == "gate" else None

    @property
    def tails(self) -> float:
        """Degrees of freedom of the noise; infinite for Gaussian noise."""
        return self.degrees_of_freedom if self.robust == "student-t" else math.inf


NEAREST_NEIGHBOUR = Association()  # the rule and the gate of the exercise
PLAIN = Robustness()


@dataclass(frozen=True)
class FilterSettings:
    """Settings of a filter; settings that a recording does not need have no effect.

    Attributes:
        association: how observations without ids are associated.
        initialisation: how bearing-only landmarks are initialised.
        frames: number of steps, evenly spread from the first to the last, at which `Estimate.history` stores the map.
        robust: how updates are guarded against outliers.
    """

    association: Association = NEAREST_NEIGHBOUR
    initialisation: Initialisation = Rays()
    frames: int = 0
    robust: Robustness = PLAIN


DEFAULTS = FilterSettings()
