"""Checks of the online filters' input; an error text is one line with place, value and remedy.

To refuse a value means to raise UserError. At every step this module checks types and shapes only. Kernels check the
numbers (`kernels.soundness`); if a number is invalid, they change nothing. Then
`explain_increment` or `explain_scan` finds the reason.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int, chunks
from slamgauge.covariances import scale_of, without_negative_eigenvalues
from slamgauge.ekf.kernels.precision import EXHAUSTED
from slamgauge.ekf.settings import Association, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.sensors import SENSORS
from slamgauge.validation import LARGEST, REAL, as_covariances, as_floats, as_ints, as_numbers, require_rows

DIVERGED = "every value is valid, so the filter has diverged; raise its noise, or start a new filter"
TOO_FAR_APART = (
    "its standard deviations and those of the filter are too far apart for double precision; "
    "raise the smallest, or lower the largest"
)
TOO_LARGE = f"a number must be below {LARGEST:g}"
LARGEST_ROUNDING = 1e-3  # largest rounding error of a correlation after a subtraction; see `kernels.precision`
TOLERATED = 1e-9  # negative eigenvalue of a correlation that `slamgauge.validation` accepts
INCREMENT = (
    "give an increment (dx, dy, dtheta) of the body frame in m, m, rad; "
    "of speed v and yaw rate omega over dt it is (v dt, 0, omega dt)"
)


def start_of(prior_mean: ArrayLike, prior_cov: ArrayLike) -> tuple[Float, Float, Float]:
    """Return the start position (2,) [m], the pose (0, 0, heading) relative to it, and the covariance (3, 3).

    Raises:
        UserError: an invalid pose or covariance.
    """
    mean = as_floats("prior_mean", prior_mean, (3,))
    return mean[:2].copy(), np.array([0.0, 0.0, mean[2]]), as_covariances("prior_cov", prior_cov, (3, 3))


def require_sensor(sensor: str, known: tuple[str, ...]) -> None:
    """Refuse a sensor that is not one of `known`, the sensors of the filter."""
    if not isinstance(sensor, str) or sensor not in known:
        raise UserError(f"sensor: {sensor!r} does not fit this filter; use one of {', '.join(known)}")


def require_gate(gate: float | None) -> None:
    """Refuse a gate outside the limits of `Association.gate`; None is allowed."""
    if gate is not None:
        Association(gate=gate)


def require_robustness(robust: Robustness) -> Robustness:
    """Return the setting; refuse an object that is not a Robustness."""
    if not isinstance(cast("object", robust), Robustness):
        raise UserError(f"robust: {robust!r} is not a Robustness; give Robustness('gate'), or leave it out")
    return robust


def load_increment(increment: ArrayLike, cov: ArrayLike, to: Float, cov_to: Float) -> None:
    """Copy an increment and its covariance into the arrays `to` (3,) and `cov_to` (3, 3).

    Raises:
        UserError: wrong shapes, or not real numbers.
    """
    if not (
        isinstance(increment, np.ndarray)
        and increment.dtype.kind in REAL
        and increment.shape == (3,)
        and isinstance(cov, np.ndarray)
        and cov.dtype.kind in REAL
        and cov.shape == (3, 3)
    ):  # at almost no step; written out, because a call takes as long as these comparisons
        increment = _shaped("increment", increment, (3,), INCREMENT)
        cov = _shaped("increment_cov", cov, (3, 3), "give shape (3, 3), of variances alone numpy.diag")
    to[...] = increment
    cov_to[...] = cov


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...], remedy: str = "") -> NDArray[np.generic]:
    """Return an array of real numbers; refuse another shape."""
    remedy = remedy or f"give shape {shape}"
    given = as_numbers(name, value, remedy)
    if given.shape == (0,) and shape[0] == 0:  # an empty list
        return given.reshape(shape)
    if given.shape != shape:
        raise UserError(f"{name}: shape {given.shape} does not fit; {remedy}")
    return given


def explain_increment(increment: Float, cov: Float) -> UserError:
    """Return the error for an increment (3,) with covariance (3, 3) that the kernel refused."""
    try:
        as_floats("increment", increment[None], (1, 3))
        as_covariances("increment_cov", cov[None], (1, 3, 3))
        believable = np.abs(increment).max() < LARGEST and np.abs(cov).max() < LARGEST**2
        require_rows("increment", [believable], increment[None], f"{TOO_LARGE}; correct it or its covariance")
    except UserError as error:
        return UserError(str(error).replace("[0] =", " ="))
    return UserError(f"increment_cov: {cov.tolist()} is not a covariance; use (P + P.T) / 2, or raise its variances")


def ids_of(observations: Observations, count: int) -> Int:
    """Return the ids (m,) of m = `count` observations.

    Raises:
        UserError: no ids, ids that are not whole numbers, or a number of ids that is not `count`.
    """
    ids = observations.landmark
    if ids is None:
        raise UserError("landmark: this filter needs known association; give the ids of the observations")
    if not isinstance(ids, np.ndarray) or ids.ndim != 1 or ids.dtype != np.int64:
        ids = as_ints("landmark", ids, (None,))
    if len(ids) != count:
        raise UserError(f"landmark: {len(ids)} ids for {count} observations; give one for each")
    return ids


def rows_of(observations: Observations, dim: int) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    """Return values (m, dim) and covariances (m, dim, dim) of the observations, which may be empty lists.

    Raises:
        UserError: wrong shapes, or not real numbers.
    """
    try:
        values, covs = observations.value, observations.cov
    except AttributeError:
        kind = type(observations).__name__
        raise UserError(
            f"observations: a {kind} is not a scan; give slamgauge.Observations(landmark, value, cov)"
        ) from None
    if (
        isinstance(values, np.ndarray)
        and values.dtype.kind in REAL
        and values.shape[1:] == (dim,)
        and isinstance(covs, np.ndarray)
        and covs.dtype.kind in REAL
        and covs.shape == (len(values), dim, dim)
    ):  # at almost every step
        return values, covs
    values = as_numbers("observation", values, f"give shape (any, {dim})")
    count = len(values) if values.ndim else 1
    shaped = _shaped("observation", values, (count, dim))
    return shaped, _shaped("observation_cov", covs, (count, dim, dim))


def explain_scan(sensor: str, values: ArrayLike, covs: ArrayLike, nis: float, variances: Float) -> UserError:
    """Return the error for observations (m, d) with covariances (m, d, d) that a kernel refused.

    Args:
        sensor: see `Recording`.
        values: the observations.
        covs: their covariances.
        nis: NIS that the kernel returned; `EXHAUSTED` if double precision is the reason.
        variances: (n,) variances of the filter. If they are valid, rounding is the reason for an innovation covariance
            that is not positive definite.
    """
    try:
        require_sound(sensor, values, covs)
    except UserError as error:
        return error
    return UserError(f"observation: no update exists for this scan; {why_not(nis, variances)}")


def why_not(nis: float, variances: Float) -> str:
    """Return why no update exists although all input is valid; arguments as in `explain_scan`."""
    if nis == EXHAUSTED:
        return TOO_FAR_APART
    return TOO_FAR_APART if np.isfinite(variances).all() and (variances >= 0.0).all() else DIVERGED


def without_rounding(name: str, covs: Float) -> Float:
    """Return covariances (n, d, d) without the negative eigenvalues that rounding causes.

    An update subtracts from the covariance. The rounding error is proportional to the covariance before the update, so
    it may exceed the difference. Only covariances whose correlation has an eigenvalue below -TOLERATED
    are changed.

    Raises:
        UserError: a value is not finite, or an eigenvalue or variance is more negative than rounding explains.
    """
    mended = covs
    for rows in chunks(len(covs)):
        singular = rows.start + _singular(name, covs[rows], rows.start)
        if len(singular):
            mended = covs.copy() if mended is covs else mended
            mended[singular] = without_negative_eigenvalues(covs[singular])
    return mended


def _singular(name: str, covs: Float, first: int) -> Int:
    """Return the indices of covariances (n, d, d) whose correlation has an eigenvalue below -TOLERATED.

    Errors as in `without_rounding`; their texts count indices from `first`.
    """
    variances = np.diagonal(covs, axis1=1, axis2=2)
    with np.errstate(invalid="ignore", over="ignore"):
        correlations = covs / scale_of(covs)
    sound = np.isfinite(correlations).all(axis=(1, 2))
    require_rows(name, sound, covs, f"not finite: {DIVERGED}", first)
    smallest = np.linalg.eigvalsh(correlations)[:, 0]
    largest = variances.max(axis=1, initial=0.0)
    rounding = (smallest >= -LARGEST_ROUNDING) & (variances >= -LARGEST_ROUNDING * largest[:, None]).all(axis=1)
    require_rows(name, rounding, covs, TOO_FAR_APART, first)
    return np.flatnonzero(smallest < -TOLERATED)


def require_sound(sensor: str, values: ArrayLike, covs: ArrayLike) -> None:
    """Refuse observations (m, d) that `Recording` refuses, with the same texts, and numbers of LARGEST or more."""
    dim = SENSORS[sensor].dim
    values = as_floats("observation", values, (None, dim))
    if SENSORS[sensor].has_range:
        require_rows("observation", values[:, 0] >= 0, values, "a range cannot be negative; drop the row")
    covs = as_covariances("observation_cov", covs, (len(values), dim, dim), definite=True)
    require_rows("observation", (np.abs(values) < LARGEST).all(axis=1), values, f"{TOO_LARGE}; drop the row")
    sizes = np.trace(covs, axis1=1, axis2=2)
    require_rows("observation_cov", sizes < LARGEST**2, covs, f"{TOO_LARGE}; drop the row")


def require_ids(ids: Int) -> None:
    """Refuse negative ids of new landmarks."""
    require_rows("landmark", ids >= 0, ids, "an id must be >= 0; use landmark=None for unknown association")
