"""What online filters refuse at their boundary, in one line: what, where, remedy.

At every step this module checks types and shapes only. Kernels check the numbers (`joint_update.are_sound`,
`prediction.predict`), and change nothing when they refuse them. The reason is determined afterwards.
"""

from __future__ import annotations

import operator
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamgauge.arrays import Float, Int, chunks
from slamgauge.covariances import scale_of, without_negative_eigenvalues
from slamgauge.ekf.kernels.rounding_limits import EXHAUSTED, LARGEST, NO_MINIMUM
from slamgauge.ekf.setting_rules import is_number, require
from slamgauge.ekf.settings import Association, Robustness
from slamgauge.errors import UserError
from slamgauge.recording import Observations
from slamgauge.sensors import SENSORS
from slamgauge.validation import REAL, as_covariances, as_floats, as_ints, as_numbers, require_rows

DIVERGED = "every value is sound, so the filter has diverged; raise its noise, or start it anew"
TOO_FAR_APART = (
    "its standard deviations and those of the filter lie so far apart that double precision does not hold both; "
    "raise the smallest, or lower the largest"
)
TOO_LARGE = f"nothing is measured in numbers beyond {LARGEST:g}"
ENDLESS = "the iterated update comes to no minimum; use another filter, or raise the noise"
WHY = {EXHAUSTED: TOO_FAR_APART, NO_MINIMUM: ENDLESS}
ROUNDING = 1e-3  # of a correlation, in what is left of a variance; see `kernels.rounding_limits`
JUDGED = 1e-9  # of a correlation; what `slamgauge.validation` lets pass
INCREMENT = "give an increment (dx, dy, dtheta) of the body frame in m, m, rad"


def start_of(prior_mean: ArrayLike, prior_cov: ArrayLike) -> tuple[Float, Float, Float]:
    """Where a filter starts (2,) [m] in the world, its pose (3,) relative to that place, and the covariance (3, 3).

    Raises:
        UserError: they are not a pose and a covariance.
    """
    mean = as_floats("prior_mean", prior_mean, (3,))
    return mean[:2].copy(), np.array([0.0, 0.0, mean[2]]), as_covariances("prior_cov", prior_cov, (3, 3))


def require_sensor(sensor: str, known: tuple[str, ...]) -> None:
    """Refuse a sensor that the filter cannot use."""
    if not isinstance(sensor, str) or sensor not in known:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise UserError(f"sensor: {sensor!r} does not fit this filter; use one of {', '.join(known)}")


def require_room(landmarks: int) -> int:
    """How many landmarks to make room for, if that is a number of landmarks."""
    try:
        count = operator.index(landmarks)
    except TypeError:
        count = -1
    if count < 0 or isinstance(landmarks, bool):
        raise UserError(f"landmarks: {landmarks!r} is not a number of landmarks; give a whole number, at least 0")
    return count


def require_radius(area_radius: float) -> None:
    """Refuse a radius that is no distance."""
    if not (is_number(area_radius) and area_radius > 0.0):
        raise UserError(f"area_radius: {area_radius!r} m is not a distance; choose it above 0")


def require_gate(gate: float | None) -> None:
    """Refuse a gate that `Association` would refuse; None is no gate."""
    if gate is not None:
        require(Association, "gate", gate)


def require_robustness(robust: Robustness) -> Robustness:
    """Refuse what is no such setting."""
    if not isinstance(cast("object", robust), Robustness):
        raise UserError(f"robust: {robust!r} is not one; give Robustness('gate'), or leave it out")
    return robust


def load_increment(increment: ArrayLike, cov: ArrayLike, to: Float, cov_to: Float) -> None:
    """Copy an increment and its covariance into arrays (3,) and (3, 3).

    Raises:
        UserError: they have other shapes, or are no real numbers.
    """
    if (
        isinstance(increment, np.ndarray)
        and increment.shape == (3,)
        and increment.dtype.kind in REAL
        and isinstance(cov, np.ndarray)
        and cov.shape == (3, 3)
        and cov.dtype.kind in REAL
    ):  # the way of almost every step
        to[:] = increment
        cov_to[:] = cov
        return
    given = as_numbers("increment", increment, INCREMENT)
    if given.shape != (3,):
        controls = "; of controls (v, omega) over dt that is (v dt, 0, omega dt)" if given.size == 2 else ""
        raise UserError(f"increment: shape {given.shape} does not fit; {INCREMENT}{controls}")
    remedy = "give shape (3, 3), of variances alone numpy.diag"
    given_cov = as_numbers("increment_cov", cov, remedy)
    if given_cov.shape != (3, 3):
        raise UserError(f"increment_cov: shape {given_cov.shape} does not fit; {remedy}")
    to[:] = given
    cov_to[:] = given_cov


def explain_increment(increment: Float, cov: Float) -> UserError:
    """Why the kernel has refused an increment (3,) with covariance (3, 3)."""
    try:
        as_floats("increment", increment[None], (1, 3))
        as_covariances("increment_cov", cov[None], (1, 3, 3))
        believable = np.abs(increment).max() < LARGEST and np.abs(cov).max() < LARGEST**2
        require_rows("increment", [believable], increment[None], f"{TOO_LARGE}; correct it or its covariance")
    except UserError as error:
        return UserError(str(error).replace("[0] =", " ="))
    return UserError(f"increment_cov: {cov.tolist()} is no covariance; use (P + P.T) / 2, or raise its variances")


def ids_of(observations: Observations, count: int) -> Int:
    """Ids (m,) of `count` observations that `rows_of` has taken.

    Raises:
        UserError: they have none, these are no whole numbers, or there are more or fewer.
    """
    ids = observations.landmark
    if ids is None:
        raise UserError("landmark: this filter needs known association; give the ids of the observations")
    if not isinstance(ids, np.ndarray) or ids.ndim != 1 or ids.dtype != np.int64:  # pyright: ignore[reportUnnecessaryIsInstance]
        ids = as_ints("landmark", ids, (None,))
    if len(ids) != count:
        raise UserError(f"landmark: {len(ids)} ids for {count} observations; give one for each")
    return ids


def rows_of(observations: Observations, dim: int) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    """Values (m, dim) and covariances (m, dim, dim) of the observations; empty lists are no observations.

    Raises:
        UserError: they have other shapes, or are no real numbers.
    """
    try:
        values, covs = observations.value, observations.cov
    except AttributeError:
        kind = type(observations).__name__
        raise UserError(
            f"observations: a {kind} is not a scan; give slamgauge.Observations(landmark, value, cov)"
        ) from None
    if (
        isinstance(values, np.ndarray)  # pyright: ignore[reportUnnecessaryIsInstance]
        and isinstance(covs, np.ndarray)  # pyright: ignore[reportUnnecessaryIsInstance]
        and values.dtype.kind in REAL
        and covs.dtype.kind in REAL
        and values.shape[1:] == (dim,)
        and covs.shape == (len(values), dim, dim)
    ):  # the way of almost every step
        return values, covs
    return _rows_of_anything(values, covs, dim)


def _rows_of_anything(values: ArrayLike, covs: ArrayLike, dim: int) -> tuple[Float, Float]:
    """What `rows_of` gives, of lists and other things that numpy can make arrays of."""
    given = as_numbers("observation", values, f"give shape (any, {dim})")
    if given.shape == (0,):
        given = given.reshape(0, dim)
    count = len(given) if given.ndim else 1
    if given.shape != (count, dim):
        raise UserError(f"observation: shape {given.shape} does not fit this sensor; give shape ({count}, {dim})")
    remedy = f"give shape ({count}, {dim}, {dim})"
    given_covs = as_numbers("observation_cov", covs, remedy)
    if count == 0 and given_covs.shape == (0,):
        given_covs = given_covs.reshape(0, dim, dim)
    if given_covs.shape != (count, dim, dim):
        raise UserError(f"observation_cov: shape {given_covs.shape} does not fit {count} observations; {remedy}")
    return given, given_covs


def explain_scan(sensor: str, values: ArrayLike, covs: ArrayLike, nis: float, variances: Float) -> UserError:
    """Why a kernel has refused observations (m, d) with covariances (m, d, d).

    Args:
        sensor: see `Recording`.
        values: the observations.
        covs: their covariances.
        nis: what the kernel has returned.
        variances: (n,) of the filter. Where these are sound, an innovation covariance that is not positive definite is
            so by rounding.
    """
    try:
        require_sound(sensor, values, covs)
    except UserError as error:
        return error
    return UserError(f"observation: no update exists for this scan; {why_not(nis, variances)}")


def why_not(nis: float, variances: Float) -> str:
    """Why there is no update, if all that was given is sound; arguments as those of `explain_scan`."""
    if nis in WHY:
        return WHY[nis]
    return TOO_FAR_APART if np.isfinite(variances).all() and (variances >= 0.0).all() else DIVERGED


def without_rounding(name: str, covs: Float) -> Float:
    """Covariances (n, d, d) without the negative eigenvalues that rounding leaves where they are singular.

    A filter subtracts from covariances, and what that leaves is exact to the rounding of what there was. Eigenvalues
    are those of correlations, as in `slamgauge.validation`, which takes the smallest of them as they are.

    Raises:
        UserError: they are more than rounding can be: precision is exhausted.
    """
    mended = covs
    for rows in chunks(len(covs)):
        singular = rows.start + _singular(name, covs[rows], rows.start)
        if len(singular):
            mended = covs.copy() if mended is covs else mended
            mended[singular] = without_negative_eigenvalues(covs[singular])
    return mended


def _singular(name: str, covs: Float, first: int) -> Int:
    """Which of the covariances (n, d, d), the first of them row `first` of all, have a negative eigenvalue."""
    variances = np.diagonal(covs, axis1=1, axis2=2)
    with np.errstate(invalid="ignore", over="ignore"):
        correlations = covs / scale_of(covs)
    sound = np.isfinite(correlations).all(axis=(1, 2))
    require_rows(name, sound, covs, f"not finite: {DIVERGED}", first)
    smallest = np.linalg.eigvalsh(correlations)[:, 0]
    largest = variances.max(axis=1, initial=0.0)
    rounding = (smallest >= -ROUNDING) & (variances >= -ROUNDING * largest[:, None]).all(axis=1)
    require_rows(name, rounding, covs, TOO_FAR_APART, first)
    return np.flatnonzero(smallest < -JUDGED)


def require_sound(sensor: str, values: ArrayLike, covs: ArrayLike) -> None:
    """Refuse observations (m, d) that a `Recording` would refuse, with its words."""
    dim = SENSORS[sensor].dim
    values = as_floats("observation", values, (None, dim))
    if SENSORS[sensor].has_range:
        require_rows("observation", values[:, 0] >= 0, values, "a range cannot be negative; drop the row")
    covs = as_covariances("observation_cov", covs, (len(values), dim, dim), definite=True)
    require_rows("observation", (np.abs(values) < LARGEST).all(axis=1), values, f"{TOO_LARGE}; drop the row")
    sizes = np.trace(covs, axis1=1, axis2=2)
    require_rows("observation_cov", sizes < LARGEST**2, covs, f"{TOO_LARGE}; drop the row")


def require_ids(ids: Int) -> None:
    """Refuse ids of new landmarks that no `Recording` may have."""
    require_rows("landmark", ids >= 0, ids, "an id must be >= 0; use landmark=None for unknown association")
