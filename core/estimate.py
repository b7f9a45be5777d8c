"""`Estimate`, the result of an estimator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.display import counted
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.validation import (
    Record,
    are_among,
    as_array,
    as_covariances,
    as_distinct_ids,
    as_floats,
    as_ints,
    require_rows,
    store,
    wrap_headings,
)

Kind = Literal["filtered", "smoothed"]


@dataclass(frozen=True, slots=True, eq=False)
class MapHistory(Record):
    """The map at some steps, in the world frame.

    A row is a landmark with one position (a point), or a member of a ray: one of several weighted Gaussian hypotheses
    for the position of a bearing-only landmark.

    Attributes:
        step: (K,) in increasing order.
        landmark: (K,) id.
        member: (K,) number of the member along its ray, from 0; -1 for a landmark that is a point.
        weight: (K,) probability of the member; 1 for a point.
        position: (K, 2) [m].
        cov: (K, 2, 2) [m^2].
    """

    step: Int
    landmark: Int
    member: Int
    weight: Float
    position: Float
    cov: Float

    def __post_init__(self) -> None:
        step = as_ints("history.step", self.step, (None,))
        require_rows(
            "history.step", np.diff(step, prepend=0) >= 0, step, "steps must not decrease; sort the rows by step"
        )
        weight = as_floats("history.weight", self.weight, (len(step),))
        require_rows("history.weight", (weight >= 0) & (weight <= 1), weight, "a weight is a probability")
        store(
            self,
            step=step,
            landmark=as_ints("history.landmark", self.landmark, (len(step),)),
            member=as_ints("history.member", self.member, (len(step),)),
            weight=weight,
            position=as_floats("history.position", self.position, (len(step), 2)),
            cov=as_covariances("history.cov", self.cov, (len(step), 2, 2)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class RayLog(Record):
    """Start, end and members of every ray of a bearing-only estimate.

    Before a bearing-only landmark becomes a point, it is a ray of members: hypotheses at different distances.

    Attributes:
        landmark: (B,) id of each ray's landmark.
        birth: (B,) step of the first bearing, at which the ray starts.
        end: (B,) step at which the ray became a point or was deleted; -1 if it still exists.
        survivor: (B,) number of the member that became the point; -1 if no member did.
        distances: (B, G) distances of the members at birth [m]; NaN for a ray with fewer than G members.
        members: (N+1,) number of members of all rays together after each step.
    """

    landmark: Int
    birth: Int
    end: Int
    survivor: Int
    distances: Float
    members: Int

    def __post_init__(self) -> None:
        landmark = as_ints("rays.landmark", self.landmark, (None,))
        birth = as_ints("rays.birth", self.birth, (len(landmark),))
        end = as_ints("rays.end", self.end, (len(landmark),))
        require_rows("rays.birth", birth >= 0, birth, "give the step at which the ray began, >= 0")
        require_rows("rays.end", (end == -1) | (end >= birth), end, "a ray cannot end before its birth; -1: open")
        distances = as_array("rays.distances", self.distances, (len(landmark), None))
        survivor = as_ints("rays.survivor", self.survivor, (len(landmark),))
        known = (survivor >= -1) & (survivor < distances.shape[1])
        require_rows("rays.survivor", known, survivor, "give the number of a member, or -1")
        members = as_ints("rays.members", self.members, (None,))
        require_rows("rays.members", members >= 0, members, "a number of members cannot be negative")
        store(self, landmark=landmark, birth=birth, end=end, survivor=survivor, distances=distances, members=members)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate(Record):
    """The result of an estimator; only `kind` and `poses` are required.

    Attributes:
        kind: `filtered` (pose k uses the measurements up to step k) or `smoothed` (uses all).
        poses: (N+1, 3) x, y [m], heading [rad] in the world frame.
        pose_covs: (N+1, 3, 3) covariances of the error estimate - truth of (x, y, heading), world frame; None if not
            estimated.
        landmark_ids: (L,) distinct ids of the mapped landmarks; empty by default.
        landmarks: (L, 2) [m] world frame, at the end of the recording, in the order of `landmark_ids`.
        landmark_covs: (L, 2, 2) [m^2]; None if not estimated.
        association: (M,) id of each observation's landmark, -1 if the observation was rejected; None if not known.
        nis: (N+1,) normalised innovation squared of each step's update; None if not computed.
        nis_dof: (N+1,) degrees of freedom of `nis`; 0 at steps without an update.
        seconds: (N+1,) computing time of each step; None if not measured.
        rays: start, end and members of the rays of a bearing-only estimate; None without rays.
        history: the map at some of the steps; None if not stored.
        chi_square: sum of squared weighted residuals of an optimum; None for a filter.
        chi_square_dof: degrees of freedom of `chi_square`: number of observed values minus two for every landmark. The
            residuals of prior and motions do not count, because there are as many pose coordinates.
        optimum_check: largest difference between a causal optimum and a separately computed optimum of the same
            measurements, at the last pose and some earlier poses (see `graph_baseline.causal`). Pose differences are
            in sigmas of the separate optimum; differences of sigmas are relative. Infinite if an optimum was not found;
            None if not checked.
    """

    kind: Kind
    poses: Float
    pose_covs: Float | None = None
    landmark_ids: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    landmarks: Float = field(default_factory=lambda: np.zeros((0, 2)))
    landmark_covs: Float | None = None
    association: Int | None = None
    nis: Float | None = None
    nis_dof: Int | None = None
    seconds: Float | None = None
    rays: RayLog | None = None
    history: MapHistory | None = None
    chi_square: float | None = None
    chi_square_dof: int | None = None
    optimum_check: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("filtered", "smoothed"):
            raise UserError(f"kind: {self.kind!r} is not known; use 'filtered' or 'smoothed'")
        poses = wrap_headings(as_floats("poses", self.poses, (None, 3)))
        count = len(poses)
        ids = as_distinct_ids("landmark_ids", self.landmark_ids)
        if not len(ids) and np.size(self.landmarks):
            raise UserError("landmark_ids: missing for the given landmarks; give the id of each row")
        store(self, poses=poses, landmark_ids=ids, landmarks=as_floats("landmarks", self.landmarks, (len(ids), 2)))
        if (self.nis is None) != (self.nis_dof is None):
            raise UserError("nis: give nis and nis_dof together, or neither")
        for name, check, shape in (
            ("pose_covs", as_covariances, (count, 3, 3)),
            ("landmark_covs", as_covariances, (len(ids), 2, 2)),
            ("association", as_ints, (None,)),
            ("nis", as_floats, (count,)),
            ("nis_dof", as_ints, (count,)),
            ("seconds", as_floats, (count,)),
        ):
            if getattr(self, name) is not None:
                store(self, **{name: check(name, getattr(self, name), shape)})
        if self.association is not None:
            known = are_among(self.association, ids) | (self.association == -1)
            rule = "give an id of landmark_ids, or -1 for a rejected observation"
            require_rows("association", known, self.association, rule)
        for name in ("chi_square", "chi_square_dof", "optimum_check"):
            if getattr(self, name) is not None:
                store(self, **{name: _as_figure(name, getattr(self, name))})
        if (self.chi_square is None) != (self.chi_square_dof is None):
            raise UserError("chi_square: give chi_square and chi_square_dof together, or neither")
        _require_on_the_path(self.rays, self.history, steps=count - 1)

    def __repr__(self) -> str:
        has = ("without", "with")[self.pose_covs is not None]
        poses, landmarks = counted(len(self.poses), "pose"), counted(len(self.landmark_ids), "landmark")
        return f"Estimate({self.kind}, {poses} {has} covariances, {landmarks})"


def _as_figure(name: str, value: object) -> float | int:
    """Return a number >= 0 as a Python number. `chi_square_dof` must be whole; only `optimum_check` may be infinite."""
    figure = float(as_array(name, value, ())[()])
    whole, endless = name == "chi_square_dof", name == "optimum_check"
    if not figure >= 0 or (figure == np.inf and not endless) or (whole and not figure.is_integer()):
        raise UserError(f"{name}: {figure:g} does not fit; give a {'whole ' * whole}number >= 0, or None")
    return int(figure) if whole else figure


def _require_on_the_path(rays: RayLog | None, history: MapHistory | None, steps: int) -> None:
    """Raise UserError if rays or map history have a step after the last pose, `steps`."""
    rule = f"a step must lie in 0..{steps}, as the poses do"
    if rays is not None:
        require_rows("rays.birth", rays.birth <= steps, rays.birth, rule)
        require_rows("rays.end", rays.end <= steps, rays.end, rule)
        as_ints("rays.members", rays.members, (steps + 1,))
    if history is not None:
        require_rows("history.step", history.step <= steps, history.step, rule)


class Estimator(Protocol):
    """A callable from a recording to an estimate."""

    def __call__(self, recording: Recording, /) -> Estimate:
        """Return the estimate. It depends on the recording only."""
        ...
