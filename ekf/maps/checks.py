"""What online filters refuse at their boundary, in one line: what, where, remedy.

On the way of every step only shapes are looked at here; numbers are looked at by the kernels (`take_in.are_sound`,
`prediction.predict`), which leave everything as it was when they refuse. Why they did is found out afterwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int
from slamgauge.errors import UserError
from slamgauge.recording import OBSERVATION_DIM, Observations
from slamgauge.validation import as_covariances, as_floats, as_ints, require_rows

DIVERGED = "every value is sound, so the filter has diverged; raise its noise, or start it anew"
INCREMENT = "give an increment (dx, dy, dtheta) of the body frame in m, m, rad"


def start_of(prior_mean: ArrayLike, prior_cov: ArrayLike) -> tuple[Float, Float, Float]:
    """Where a filter starts (2,) [m] in the world, its pose (3,) relative to that place, and the covariance (3, 3).

    Raises:
        UserError: they are none.
    """
    mean = as_floats("prior_mean", prior_mean, (3,))
    return mean[:2].copy(), np.array([0.0, 0.0, mean[2]]), as_covariances("prior_cov", prior_cov, (3, 3))


def require_sensor(sensor: str, known: tuple[str, ...]) -> None:
    """Refuse a sensor that the filter cannot use."""
    if sensor not in known:
        raise UserError(f"sensor: {sensor!r} does not fit this filter; use one of {', '.join(known)}")


def require_gate(gate: float | None) -> None:
    """Refuse a gate that is no squared distance."""
    if gate is not None and not gate > 0.0:
        raise UserError(f"gate: {gate} lets nothing pass; give a squared Mahalanobis distance above 0")


def load_increment(increment: ArrayLike, cov: ArrayLike, to: Float, cov_to: Float) -> None:
    """Copy an increment and its covariance into arrays (3,) and (3, 3).

    Raises:
        UserError: they have other shapes.
    """
    if (
        isinstance(increment, np.ndarray)
        and increment.shape == (3,)
        and isinstance(cov, np.ndarray)
        and cov.shape == (3, 3)
    ):  # the way of almost every step
        to[:] = increment
        cov_to[:] = cov
        return
    try:
        given, given_cov = np.asarray(increment, dtype=np.float64), np.asarray(cov, dtype=np.float64)
    except (TypeError, ValueError):
        raise UserError(f"increment: not an array of numbers; {INCREMENT}, and its covariance (3, 3)") from None
    if given.shape != (3,):
        controls = "; of controls (v, omega) over dt that is (v dt, 0, omega dt)" if given.size == 2 else ""
        raise UserError(f"increment: shape {given.shape} does not fit; {INCREMENT}{controls}")
    if given_cov.shape != (3, 3):
        remedy = "give shape (3, 3), of variances alone numpy.diag"
        raise UserError(f"increment_cov: shape {given_cov.shape} does not fit; {remedy}")
    to[:] = given
    cov_to[:] = given_cov


def explain_increment(increment: Float, cov: Float) -> UserError:
    """Why the kernel has refused an increment (3,) with covariance (3, 3)."""
    try:
        as_floats("increment", increment[None], (1, 3))
        as_covariances("increment_cov", cov[None], (1, 3, 3))
    except UserError as error:
        return UserError(str(error).replace("[0] =", " ="))
    return UserError(f"increment_cov: {cov.tolist()} is no covariance; use (P + P.T) / 2, or raise its variances")


def ids_of(observations: Observations) -> Int:
    """Ids (m,) of the observations.

    Raises:
        UserError: they have none, or these are no whole numbers.
    """
    if observations.landmark is None:
        raise UserError("landmark: this filter needs known association; give the ids of the observations")
    ids = np.asarray(observations.landmark)
    if ids.ndim != 1 or ids.dtype != np.int64:
        ids = as_ints("landmark", ids, (None,))
    if len(ids) != len(observations.value):
        raise UserError(f"landmark: {len(ids)} ids for {len(observations.value)} observations; give one for each")
    return ids


def rows_of(observations: Observations, dim: int) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    """Values (m, dim) and covariances (m, dim, dim) of the observations; only their shapes are looked at.

    Raises:
        UserError: they have other shapes.
    """
    values, covs = np.asarray(observations.value), np.asarray(observations.cov)
    count = len(values)
    if values.shape != (count, dim):
        raise UserError(f"observation: shape {values.shape} does not fit this sensor; give shape ({count}, {dim})")
    if covs.shape != (count, dim, dim):
        shapes = f"shape {covs.shape} does not fit {count} observations"
        raise UserError(f"observation_cov: {shapes}; give shape ({count}, {dim}, {dim})")
    return values, covs


def explain_scan(sensor: str, values: ArrayLike, covs: ArrayLike) -> UserError:
    """Why a kernel has refused observations (m, d) with covariances (m, d, d)."""
    try:
        require_sound(sensor, values, covs)
    except UserError as error:
        return error
    return UserError(f"observation: no update exists for this scan; {DIVERGED}")


def require_sound(sensor: str, values: ArrayLike, covs: ArrayLike) -> None:
    """Refuse observations (m, d) that a `Recording` would refuse, with its words."""
    dim = OBSERVATION_DIM[sensor]
    values = as_floats("observation", values, (None, dim))
    if sensor == "range-bearing":
        require_rows("observation", values[:, 0] >= 0, values, "a range cannot be negative; drop the row")
    as_covariances("observation_cov", covs, (len(values), dim, dim), definite=True)


def require_ids(ids: Int) -> None:
    """Refuse ids of new landmarks that no `Recording` may have."""
    require_rows("landmark", ids >= 0, ids, "an id must be >= 0; use landmark=None for unknown association")
