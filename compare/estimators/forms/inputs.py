"""Inputs of a step as user code takes them, and sentences on the noise that a file assumes."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.sensors import SENSORS

CLOSE = 1e-3  # largest relative difference of equal settings


def require_ranges_and_bearings(recording: Recording) -> None:
    """Refuse recordings of another sensor.

    Raises:
        UserCodeError: the recording lacks ranges or bearings.
    """
    if not SENSORS[recording.sensor].has_range or not SENSORS[recording.sensor].has_bearing:
        raise UserCodeError("it takes ranges and bearings; give a recording that has them")


def step_length(recording: Recording, step: int) -> float:
    """Return the length of a step [s]; a scan at step 0 has that of step 1."""
    last = min(max(step, 1), recording.steps)
    return float(recording.stamps[last] - recording.stamps[last - 1]) if last else 1.0


def control_cov(recording: Recording, step: int) -> Float:
    """Return the covariance (2, 2) of speed [m/s] and yaw rate [rad/s] in a step; step 0 has that of step 1."""
    if not recording.steps:
        return np.zeros((2, 2))
    cov: Float = recording.odometry_cov[max(step, 1) - 1][np.ix_([0, 2], [0, 2])]
    return cov / step_length(recording, step) ** 2


def increment_cov(recording: Recording, step: int) -> Float:
    """Return the covariance (3, 3) of the increment of a step [m, m, rad]; step 0 has that of step 1."""
    return recording.odometry_cov[max(step, 1) - 1].copy() if recording.steps else np.zeros((3, 3))


def world_cov(recording: Recording, step: int, heading: float) -> Float:
    """Return the covariance (3, 3) of the motion of a step in the world frame, for the heading [rad] before it."""
    turn = block_diagonal(rotation(heading), np.eye(1))
    return turn @ increment_cov(recording, step) @ turn.T


def observation_cov(recording: Recording) -> Float:
    """Return the covariance (d, d) of the first observation."""
    return recording.observation_cov[0] if len(recording.observation_cov) else np.eye(2)


def block_diagonal(*blocks: Float) -> Float:
    """Return a matrix with square blocks on its diagonal.

    The import of `scipy.linalg` would take a quarter of the time in which a process with user code starts.
    """
    ends = np.cumsum([0, *map(len, blocks)])
    whole = np.zeros((ends[-1], ends[-1]))
    for block, start, end in zip(blocks, ends[:-1], ends[1:], strict=True):
        whole[start:end, start:end] = block
    return whole


def numbers(value: object) -> Float:
    """Return a copy of a value as an array of numbers; an empty array if it is not one."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)


def noise_remark(name: str, own: object, given: Float, *, is_replaced: bool) -> str:
    """Compare a covariance of a file with that of the recording; return an empty text if they are equal.

    Args:
        name: name of the covariance.
        own: that of the file; if `given` is that of bearings, its last row counts.
        given: that of the recording.
        is_replaced: whether the recording's is used.
    """
    values = np.atleast_2d(numbers(own))
    if values.shape[:1] == (2,) and values.ndim == 2 and len(given) == 1:
        values = values[-1:, -1:]
    if values.shape == given.shape and np.allclose(values, given, rtol=CLOSE, atol=1e-12 * abs(given).max()):
        return ""
    is_root = values.shape == given.shape and np.allclose(values, np.sqrt(abs(given)), rtol=CLOSE, atol=0.0)
    hint = ": it has standard deviations, a square is missing" if is_root else ""
    if is_replaced:
        return f"{name} of the file, {shown(own)}, is replaced by the recording's, {shown(given)}{hint}"
    return f"assumes {name} of the file, {shown(own)}, where the recording has {shown(given)}{hint}"


def shown(value: object) -> str:
    """Return a matrix in few characters, `diag(0.09, 0.0027)` if it is diagonal."""
    array = numbers(value)
    if not array.size:
        return repr(value)[:40]
    if array.ndim == 2 and len({*array.shape}) == 1 and not (array - np.diag(np.diag(array))).any():
        return f"diag({', '.join(f'{each:.3g}' for each in np.diag(array))})"
    return np.array2string(array, precision=3, separator=", ").replace("\n", "")
