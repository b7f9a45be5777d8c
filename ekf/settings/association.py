"""How observations without ids find their landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

from slamgauge.ekf.settings.validation import check, gate_setting, setting
from slamgauge.errors import UserError

Method = Literal["nearest-neighbour", "jcbb"]


@dataclass(frozen=True)
class MapManagement:
    """When a track becomes a landmark, and when two become one.

    Attributes:
        sights: observations that confirm a new track.
        probation: scans after which a track that is not confirmed is deleted, the scan of its birth included.
        margin: `jcbb` leaves out observations whose landmarks another association, with a joint squared distance
            larger by less than this, would change: it is at least exp(-margin / 2) times as likely.
        new_gate: an observation within this squared Mahalanobis distance of a landmark that the scan has not
            given to another observation may be that landmark's outlier, and starts no track. The default is
            exceeded once in a million (chi-square, 2 degrees of freedom).
        vagueness: a scan tells by itself a landmark that one of the last `probation` scans has seen, unless the robot
            has been blind since (see `maps.scan_clock`), or whose place relative to the robot is known to this many
            times the noise of an observation (variances; see
            `kernels.individual_compatibility.find_located`). What it sees of others begins tracks,
            which are joined with them.
        merge_gate: two landmarks never seen in one scan may be one when the squared Mahalanobis distance
            of their difference from zero is below this (again, one in a million of true doubles fails that), ...
        certainty: ... and are joined when of all ways to match the tracks of a scan with landmarks, by weight, at
            least this share agrees on it (see `maps.duplicate_landmarks`), ...
        new_density: ... where landmarks that were never seen before are this dense [1/m^2].
    """

    sights: int = setting(5, lambda n: n >= 1, "{} confirm no track; choose at least 1")
    probation: int = setting(10, lambda n: n >= 1, "{} scans show no track; choose at least 1")
    margin: float = setting(6.0, lambda m: m >= 0.0, "{} is no distance; choose it at least 0")
    new_gate: float = setting(27.6, lambda g: g >= 0.0, "{} is no squared distance; choose it at least 0")
    merge_gate: float = setting(27.6, lambda g: g >= 0.0, "{} is no squared distance; choose it at least 0")
    vagueness: float = setting(6.0, lambda v: v > 0.0, "{} lets nothing be known; choose it above 0")
    certainty: float = setting(0.99, lambda c: 0.5 < c <= 1.0, "{} is no certainty; choose it above 0.5, at most 1")
    new_density: float = setting(3e-4, lambda d: d > 0.0, "{} is no density; choose it above 0")

    def __post_init__(self) -> None:
        check(self)
        if self.sights > self.probation:
            scans = f"{self.probation} scans of probation"
            raise UserError(f"sights: {self.sights} do not fit into {scans}; choose at most {self.probation}")


@dataclass(frozen=True)
class Association:
    """How observations without ids find their landmarks.

    Attributes:
        method: `nearest-neighbour` or `jcbb`.
        gate: largest squared Mahalanobis distance of a pair. `jcbb` holds k pairs together to the quantile of
            the chi-square distribution with 2k degrees of freedom that has the probability of `gate` with 2.
        map_management: probation, deletion and merging of landmarks; None is the practical's bare rule.
        node_limit: pairs that `jcbb` tries in a scan at most; it then goes on with the best set so far, which
            is at least the nearest neighbours that are jointly compatible. For map management as many
            again are tried at most to find ambiguous observations; what is left then counts as certain.
    """

    method: Method = "nearest-neighbour"
    gate: float = gate_setting()
    map_management: MapManagement | None = None
    node_limit: int = setting(20_000, lambda n: n >= 1, "{} pairs are no search; choose at least 1")

    def __post_init__(self) -> None:
        check(self)
        managed = cast("object", self.map_management)
        if not (managed is None or isinstance(managed, MapManagement)):
            raise UserError(f"map_management: {managed!r} is not one; give MapManagement(), or None to go without")


NEAREST_NEIGHBOUR = Association()  # the practical's rule and gate
