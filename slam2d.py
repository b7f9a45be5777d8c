"""The vocabulary of slamgauge: planar poses, recordings, truths and estimates.

Frames and units. A pose is ``(x, y, heading)`` in the world frame, metres and radians, heading in
(-pi, pi]. An increment ``(dx, dy, dtheta)`` is expressed in the body frame at the start of its step.
Pose covariances belong to the additive error ``(x, y, heading)`` in the world frame.

Every constructor below copies its arrays, checks them and makes them read-only. A value that does
not fit raises ``ValueError`` with the field, the row, the value and the remedy in one line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Sensor = Literal["range-bearing", "bearing", "position"]
Kind = Literal["filtered", "smoothed"]

OBSERVATION_DIM: dict[str, int] = {"range-bearing": 2, "bearing": 1, "position": 2}


# --- SE(2) -------------------------------------------------------------------------------------


def wrap(angle: ArrayLike) -> Float:
    """Angle(s) in rad brought into (-pi, pi]; an angle already there is returned unchanged."""
    angle = np.asarray(angle, dtype=np.float64)
    wrapped = angle - 2.0 * np.pi * np.ceil((angle - np.pi) / (2.0 * np.pi))
    wrapped = np.where((wrapped <= -np.pi) | (wrapped > np.pi), np.pi, wrapped)  # rounding at the seam
    return np.where((angle > -np.pi) & (angle <= np.pi), angle, wrapped)


def rotation(heading: ArrayLike) -> Float:
    """Rotation matrices (..., 2, 2) that take body-frame vectors at `heading` [rad] to the world."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def compose(pose: ArrayLike, increment: ArrayLike) -> Float:
    """Poses (..., 3) reached from `pose` by the body-frame `increment` (..., 3)."""
    pose, increment = np.asarray(pose, dtype=np.float64), np.asarray(increment, dtype=np.float64)
    position = pose[..., :2] + np.einsum("...ij,...j->...i", rotation(pose[..., 2]), increment[..., :2])
    heading = wrap(pose[..., 2] + increment[..., 2])
    return np.concatenate([position, heading[..., None]], axis=-1)


def between(start: ArrayLike, end: ArrayLike) -> Float:
    """Body-frame increments (..., 3) that lead from the poses `start` to the poses `end`."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    displacement = end[..., :2] - start[..., :2]
    position = np.einsum("...ji,...j->...i", rotation(start[..., 2]), displacement)
    return np.concatenate([position, wrap(end[..., 2] - start[..., 2])[..., None]], axis=-1)


def chain(start: ArrayLike, increments: ArrayLike) -> Float:
    """Poses (N+1, 3) of a path from `start` (3,) along body-frame `increments` (N, 3)."""
    start, increments = np.asarray(start, dtype=np.float64), np.asarray(increments, dtype=np.float64)
    headings = start[2] + np.concatenate([[0.0], np.cumsum(increments[:, 2])])
    steps = np.einsum("nij,nj->ni", rotation(headings[:-1]), increments[:, :2])
    positions = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([positions, wrap(headings)])


# --- bearings ---------------------------------------------------------------------------------

GAUSS_NEWTON_STEPS = 8
SETTLED = 0.1  # standard deviations: a landmark that moves less has been found


class Triangulation(NamedTuple):
    """A landmark (2,) [m] from its bearings, and its largest standard deviation [m], poses taken as exact."""

    landmark: Float
    sigma: float
    placed: bool


def triangulate(poses: Float, bearings: Float, variances: Float, sure: float) -> Triangulation:
    """The landmark of largest likelihood: Gauss-Newton from the least squares on distances from the lines of sight.

    Args:
        poses: (n, 3) that saw the landmark.
        bearings: (n,) [rad] in the body frame.
        variances: (n,) [rad^2].
        sure: largest standard deviation of a landmark that is `placed`, as a share of its distance.

    Returns:
        The landmark; one that is placed lies in front of the poses.
    """
    angle = poses[:, 2] + bearings
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    gradient = np.column_stack([-along[:, 1], along[:, 0]])
    residual = (gradient * poses[:, :2]).sum(axis=1)
    landmark, sigma, step, offset, squared = np.zeros(2), np.inf, np.inf, along, np.ones(len(poses))
    for _ in range(GAUSS_NEWTON_STEPS):
        weighted = gradient / variances[:, None]
        information = weighted.T @ gradient
        weakest = float(np.linalg.eigvalsh(information)[0])
        if not weakest > 1e-12 * float(np.trace(information)):
            return Triangulation(poses[-1, :2] + along[-1], np.inf, placed=False)
        move = np.linalg.solve(information, weighted.T @ residual)
        landmark = landmark + move
        sigma, step = 1.0 / np.sqrt(weakest), float(np.hypot(*move))
        offset = landmark - poses[:, :2]
        squared = np.maximum((offset**2).sum(axis=1), 1e-6)
        gradient = np.column_stack([-offset[:, 1], offset[:, 0]]) / squared[:, None]
        residual = wrap(angle - np.arctan2(offset[:, 1], offset[:, 0]))
    ahead = float(np.mean((offset * along).sum(axis=1) > 0.0))
    settled = step < SETTLED * sigma < SETTLED * sure * float(np.sqrt(squared.min()))
    return Triangulation(landmark, sigma, placed=bool(ahead > 0.5 and settled))


# --- data --------------------------------------------------------------------------------------


class Observations(NamedTuple):
    """What the sensor saw at one step: ids (m,), values (m, d) and covariances (m, d, d)."""

    landmark: Int | None
    value: Float
    cov: Float


@dataclass(frozen=True, slots=True)
class Recording:
    """All that an estimator may see: N odometry increments and M landmark observations.

    Attributes:
        stamps: (N+1,) [s], strictly increasing; step k leads from stamp k-1 to stamp k.
        prior_mean: (3,) mean of the start pose.
        prior_cov: (3, 3) its covariance; may be zero (a fixed start).
        odometry: (N, 3) body-frame increments (dx, dy, dtheta).
        odometry_cov: (N, 3, 3) as estimators shall assume it; may be singular.
        sensor: `range-bearing` (range [m], bearing [rad]), `bearing` ([rad]) or `position`
            (landmark in the body frame, [m]).
        observation_step: (M,) in 0..N, in increasing order; the pose that observed.
        observation: (M, d) values.
        observation_cov: (M, d, d) as estimators shall assume it, positive definite.
        landmark: (M,) ids >= 0, or None when the association is unknown.
    """

    stamps: Float
    prior_mean: Float
    prior_cov: Float
    odometry: Float
    odometry_cov: Float
    sensor: Sensor
    observation_step: Int
    observation: Float
    observation_cov: Float
    landmark: Int | None

    def __post_init__(self) -> None:
        odometry = _floats("odometry", self.odometry, (None, 3))
        steps = len(odometry)
        stamps = _floats("stamps", self.stamps, (steps + 1,))
        _each("stamps", np.diff(stamps, prepend=-np.inf) > 0, stamps, "stamps must increase strictly; sort the steps")
        if self.sensor not in OBSERVATION_DIM:
            raise ValueError(f"sensor: {self.sensor!r} is not known; use one of {', '.join(OBSERVATION_DIM)}")
        dim = OBSERVATION_DIM[self.sensor]
        observation = _floats("observation", self.observation, (None, dim))
        count = len(observation)
        if self.sensor == "range-bearing":
            _each("observation", observation[:, 0] >= 0, observation, "a range cannot be negative; drop the row")
        observation_step = _ints("observation_step", self.observation_step, (count,))
        in_range = (observation_step >= 0) & (observation_step <= steps)
        _each("observation_step", in_range, observation_step, f"a step must lie in 0..{steps}")
        ordered = np.diff(observation_step, prepend=0) >= 0
        _each("observation_step", ordered, observation_step, "steps must not decrease; sort the observations by step")
        landmark = None
        if self.landmark is not None:
            landmark = _ints("landmark", self.landmark, (count,))
            _each("landmark", landmark >= 0, landmark, "an id must be >= 0; use landmark=None for unknown association")
        _set(
            self,
            stamps=stamps,
            prior_mean=_floats("prior_mean", self.prior_mean, (3,)),
            prior_cov=_covariances("prior_cov", self.prior_cov, (3, 3)),
            odometry=odometry,
            odometry_cov=_covariances("odometry_cov", self.odometry_cov, (steps, 3, 3)),
            observation=observation,
            observation_step=observation_step,
            observation_cov=_covariances("observation_cov", self.observation_cov, (count, dim, dim), definite=True),
            landmark=landmark,
        )

    @property
    def steps(self) -> int:
        """Number N of odometry increments."""
        return len(self.odometry)

    def first(self, steps: int) -> Recording:
        """The recording up to pose `steps` and with its observations."""
        last = int(np.searchsorted(self.observation_step, steps, side="right"))
        return replace(
            self,
            stamps=self.stamps[: steps + 1],
            odometry=self.odometry[:steps],
            odometry_cov=self.odometry_cov[:steps],
            observation_step=self.observation_step[:last],
            observation=self.observation[:last],
            observation_cov=self.observation_cov[:last],
            landmark=None if self.landmark is None else self.landmark[:last],
        )

    def only(self, kept: NDArray[np.bool_]) -> Recording:
        """The recording with the `kept` (M,) observations alone."""
        return replace(
            self,
            observation_step=self.observation_step[kept],
            observation=self.observation[kept],
            observation_cov=self.observation_cov[kept],
            landmark=None if self.landmark is None else self.landmark[kept],
        )

    def associated(self, association: Int) -> Recording:
        """The recording with the ids of an `Estimate.association` (M,), without the observations it rejects (-1)."""
        kept = np.asarray(association) >= 0
        return replace(self, landmark=np.where(kept, association, 0)).only(kept)

    def scans(self) -> Iterator[Observations]:
        """The observations of step 0, 1, ..., N in turn (views, not copies)."""
        bounds = np.searchsorted(self.observation_step, np.arange(self.steps + 2)).tolist()
        for first, last in pairwise(bounds):
            ids = None if self.landmark is None else self.landmark[first:last]
            yield Observations(ids, self.observation[first:last], self.observation_cov[first:last])


@dataclass(frozen=True, slots=True)
class Truth:
    """What only the scores may see; a field is None where a real recording has no ground truth.

    Attributes:
        poses: (N+1, 3); a row of NaN where the ground truth has a gap.
        landmark_ids: (L,) distinct ids >= 0.
        landmarks: (L, 2) [m].
        association: (M,) true landmark id of each observation.
    """

    poses: Float | None = None
    landmark_ids: Int | None = None
    landmarks: Float | None = None
    association: Int | None = None

    def __post_init__(self) -> None:
        if self.poses is not None:
            poses = _array("poses", self.poses, (None, 3))
            gap = np.isnan(poses).all(axis=1)
            _each("poses", np.isfinite(poses).all(axis=1) | gap, poses, "use finite numbers, or NaN in the whole row")
            _set(self, poses=_wrapped(poses))
        if (self.landmark_ids is None) != (self.landmarks is None):
            raise ValueError("landmarks: give landmark_ids and landmarks together, or neither")
        if self.landmark_ids is not None and self.landmarks is not None:
            landmark_ids = _distinct_ids("landmark_ids", self.landmark_ids)
            _set(
                self,
                landmark_ids=landmark_ids,
                landmarks=_floats("landmarks", self.landmarks, (len(landmark_ids), 2)),
            )
        if self.association is not None:
            association = _ints("association", self.association, (None,))
            known = association >= 0
            if self.landmark_ids is not None:
                known &= np.isin(association, self.landmark_ids)
            _each("association", known, association, "every true id must be among landmark_ids")
            _set(self, association=association)


@dataclass(frozen=True, slots=True)
class MapHistory:
    """The map as it stood at some steps: a row for every landmark, or for every member of one that is a ray still.

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
        step = _ints("history.step", self.step, (None,))
        _each("history.step", np.diff(step, prepend=0) >= 0, step, "steps must not decrease; sort the rows by step")
        weight = _floats("history.weight", self.weight, (len(step),))
        _each("history.weight", (weight >= 0) & (weight <= 1), weight, "a weight is a probability")
        _set(
            self,
            step=step,
            landmark=_ints("history.landmark", self.landmark, (len(step),)),
            member=_ints("history.member", self.member, (len(step),)),
            weight=weight,
            position=_floats("history.position", self.position, (len(step), 2)),
            cov=_covariances("history.cov", self.cov, (len(step), 2, 2)),
        )


@dataclass(frozen=True, slots=True)
class RayLog:
    """What became of every ray of a bearing-only estimate.

    Attributes:
        landmark: (B,) id of each ray's landmark.
        birth: (B,) step at which it began.
        end: (B,) step at which it became a point or was lost; -1 if it is a ray still.
        survivor: (B,) number of the member that became the point; -1 if there is none.
        distances: (B, G) distances of the members at birth [m], NaN where a ray had fewer.
        members: (N+1,) members of all rays after each step.
    """

    landmark: Int
    birth: Int
    end: Int
    survivor: Int
    distances: Float
    members: Int

    def __post_init__(self) -> None:
        landmark = _ints("rays.landmark", self.landmark, (None,))
        ints = {name: _ints(f"rays.{name}", getattr(self, name), (len(landmark),)) for name in ("birth", "end")}
        distances = _array("rays.distances", self.distances, (len(landmark), None))
        survivor = _ints("rays.survivor", self.survivor, (len(landmark),))
        known = (survivor >= -1) & (survivor < distances.shape[1])
        _each("rays.survivor", known, survivor, "give the number of a member, or -1")
        members = _ints("rays.members", self.members, (None,))
        _set(self, landmark=landmark, survivor=survivor, distances=distances, members=members, **ints)


@dataclass(frozen=True, slots=True)
class Estimate:
    """What an estimator returns; only `kind` and `poses` are required.

    Attributes:
        kind: `filtered` (pose k uses the measurements up to step k) or `smoothed` (uses all).
        poses: (N+1, 3).
        pose_covs: (N+1, 3, 3) world frame, additive error (x, y, heading); None if not estimated.
        landmark_ids: (L,) distinct ids of the mapped landmarks.
        landmarks: (L, 2) [m] at the end of the recording.
        landmark_covs: (L, 2, 2) [m^2]; None if not estimated.
        association: (M,) id of the landmark that each observation was given, -1 if rejected.
        nis: (N+1,) normalised innovation squared of each step's update; None if there is none.
        nis_dof: (N+1,) its degrees of freedom, 0 where there was no update.
        seconds: (N+1,) computing time of each step; None if not measured.
        rays: what became of the rays of a bearing-only estimate; None without rays.
        history: the map at some of the steps; None if it was not kept.
    """

    kind: Kind
    poses: Float
    pose_covs: Float | None = None
    landmark_ids: Int | None = None
    landmarks: Float | None = None
    landmark_covs: Float | None = None
    association: Int | None = None
    nis: Float | None = None
    nis_dof: Int | None = None
    seconds: Float | None = None
    rays: RayLog | None = None
    history: MapHistory | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("filtered", "smoothed"):
            raise ValueError(f"kind: {self.kind!r} is not known; use 'filtered' or 'smoothed'")
        poses = _wrapped(_floats("poses", self.poses, (None, 3)))
        count = len(poses)
        empty = self.landmark_ids is None and self.landmarks is None
        ids = _distinct_ids("landmark_ids", np.zeros(0, np.int64) if empty else self.landmark_ids)
        landmarks = _floats("landmarks", np.zeros((0, 2)) if empty else self.landmarks, (len(ids), 2))
        _set(self, poses=poses, landmark_ids=ids, landmarks=landmarks)
        if self.pose_covs is not None:
            _set(self, pose_covs=_covariances("pose_covs", self.pose_covs, (count, 3, 3)))
        if self.landmark_covs is not None:
            _set(self, landmark_covs=_covariances("landmark_covs", self.landmark_covs, (len(ids), 2, 2)))
        if self.association is not None:
            association = _ints("association", self.association, (None,))
            known = np.isin(association, ids) | (association == -1)
            _each("association", known, association, "give an id of landmark_ids, or -1 for a rejected observation")
            _set(self, association=association)
        if (self.nis is None) != (self.nis_dof is None):
            raise ValueError("nis: give nis and nis_dof together, or neither")
        if self.nis is not None and self.nis_dof is not None:
            _set(self, nis=_floats("nis", self.nis, (count,)), nis_dof=_ints("nis_dof", self.nis_dof, (count,)))
        if self.seconds is not None:
            _set(self, seconds=_floats("seconds", self.seconds, (count,)))


class Estimator(Protocol):
    """Anything that turns a recording into an estimate."""

    def __call__(self, recording: Recording, /) -> Estimate:
        """Estimate from the recording alone."""
        ...


# --- validation --------------------------------------------------------------------------------


def _set(instance: object, **fields: object) -> None:
    """Store checked fields in a frozen dataclass; arrays become read-only."""
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        object.__setattr__(instance, name, value)


def _array(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    """A float64 copy of `value` with the given shape (None: any length)."""
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise ValueError(f"{name}: not an array of numbers; give shape {_spell(shape)}") from None
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name}: shape {array.shape} does not fit; give shape {_spell(shape)}")
    return array


def _spell(shape: tuple[int | None, ...]) -> str:
    sizes = ["any" if n is None else str(n) for n in shape]
    return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"


def _floats(name: str, value: object, shape: tuple[int | None, ...]) -> Float:
    array = _array(name, value, shape)
    finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    _each(name, finite, array, "every number must be finite")
    return array


def _ints(name: str, value: object, shape: tuple[int | None, ...]) -> Int:
    array = _floats(name, value, shape)
    whole = (array == np.floor(array)) & (np.abs(array) < 2.0**53)
    _each(name, whole, array, "every entry must be a whole number below 2**53")
    return array.astype(np.int64)


def _distinct_ids(name: str, value: object) -> Int:
    ids = _ints(name, value, (None,))
    first = np.zeros(len(ids), dtype=bool)
    first[np.unique(ids, return_index=True)[1]] = True
    _each(name, first & (ids >= 0), ids, "ids must be >= 0 and distinct")
    return ids


def _covariances(name: str, value: object, shape: tuple[int | None, ...], *, definite: bool = False) -> Float:
    """Symmetric positive semi-definite (or definite) matrices, exactly symmetric on return."""
    array = _floats(name, value, shape)
    stack = array.reshape(-1, *array.shape[-2:])
    transposed = stack.swapaxes(1, 2)
    scale = np.abs(stack).max(axis=(1, 2), initial=0.0)
    sigmas = np.sqrt(np.abs(np.diagonal(stack, axis1=1, axis2=2)))  # units differ: judge each pair by its own
    allowed = 1e-9 * sigmas[:, :, None] * sigmas[:, None, :] + 1e-15 * scale[:, None, None]
    symmetric = (np.abs(stack - transposed) <= allowed).all(axis=(1, 2))
    _each(name, symmetric, stack, "a covariance must be symmetric; use (P + P.T) / 2")
    stack = (stack + transposed) / 2
    variances = np.diagonal(stack, axis1=1, axis2=2)
    nonnegative = (variances >= -1e-12 * scale[:, None]).all(axis=1)
    _each(name, nonnegative, stack, "a covariance must not have a negative variance")
    sigmas = np.sqrt(np.where(variances > 0, variances, 1.0))
    smallest = np.linalg.eigvalsh(stack / (sigmas[:, :, None] * sigmas[:, None, :]))[:, 0]
    _each(name, smallest >= -1e-9, stack, "a covariance must not have a negative eigenvalue")
    if definite:
        _each(name, smallest > 1e-12, stack, "a covariance must be positive definite here; raise its variances")
    return stack.reshape(array.shape)


def _wrapped(poses: Float) -> Float:
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def _each(name: str, good: ArrayLike, rows: NDArray[np.generic], rule: str) -> None:
    """Raise for the first row that breaks `rule`, naming field, row and value."""
    bad = np.flatnonzero(np.logical_not(good))
    if len(bad):
        value = np.array2string(np.asarray(rows[bad[0]]), precision=6, separator=", ").replace("\n", "")
        raise ValueError(f"{name}[{bad[0]}] = {value}: {rule}")
