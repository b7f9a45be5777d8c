"""Search for the convention that user code follows: a tiny recording with a known answer, tried with each candidate.

The recording has no noise, so that a right filter returns the true state, whatever noise it assumes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.captured_output import discarded
from slamgauge.compare.estimators.user_code import UserCodeError, reason_of
from slamgauge.recording import Recording
from slamgauge.se2 import compose, wrap

C = TypeVar("C")
EXACT = 1e-6  # errors up to this are rounding; the search ends there


class TinyRecording(NamedTuple):
    """A recording of two steps and its answer.

    Attributes:
        recording: ranges, bearings and ids 0..3; scans of 2 and 4 observations.
        poses: (3, 3) true poses of steps 0..2 [m, m, rad].
        landmarks: (4, 2) true positions of the landmarks 0..3 [m].
    """

    recording: Recording
    poses: Float
    landmarks: Float


def tiny_recording(sideways: float = 0.0) -> TinyRecording:
    """Make the recording: step 1 observes landmarks 0 and 3, step 2 observes 3, 1, 0 and 2.

    Args:
        sideways: motion to the left in step 1, and half of it to the right in step 2 [m].
    """
    odometry = np.array([[0.5, sideways, 0.3], [0.4, -sideways / 2, -0.2]])
    poses = [np.array([0.3, -0.2, 0.4])]
    for increment in odometry:
        poses.append(compose(poses[-1], increment))
    landmarks = np.array([[3.0, 1.0], [2.5, 2.5], [1.5, 3.5], [4.0, -0.5]])
    steps, ids = np.array([1, 1, 2, 2, 2, 2]), np.array([0, 3, 3, 1, 0, 2])
    ways = landmarks[ids] - np.array(poses)[steps, :2]
    bearings = wrap(np.arctan2(ways[:, 1], ways[:, 0]) - np.array(poses)[steps, 2])
    recording = Recording(
        stamps=np.arange(3.0),
        prior_mean=poses[0],
        prior_cov=1e-4 * np.eye(3),
        odometry=odometry,
        odometry_cov=1e-2 * np.eye(3),
        sensor="range-bearing",
        observation_step=steps,
        observation=np.column_stack([np.hypot(*ways.T), bearings]),
        observation_cov=1e-2 * np.eye(2),
        landmark=ids,
    )
    return TinyRecording(recording, np.array(poses), landmarks)


def closest(candidates: Iterable[C], attempt: Callable[[C], Iterator[float]], tried: str) -> C:
    """Return the first candidate without an error, or the candidate with the smallest error.

    Args:
        candidates: conventions.
        attempt: runs user code by a convention and yields its error after every call, the error that counts last.
        tried: description of the candidates for the error message.

    Raises:
        UserCodeError: all candidates raise errors; its reason is that of the candidate that came farthest.
    """
    best: tuple[float, C] | None = None
    farthest: tuple[int, Exception] | None = None
    for candidate in candidates:
        errors: list[float] = []
        try:
            with discarded():
                for error in attempt(candidate):
                    errors.append(error)  # noqa: PERF402 errors before an exception count
        except Exception as raised:  # noqa: BLE001 whatever user code raises
            if farthest is None or len(errors) > farthest[0]:
                farthest = (len(errors), raised)
            continue
        last = errors[-1] if errors and np.isfinite(errors[-1]) else np.inf
        if best is None or last < best[0]:
            best = (last, candidate)
        if last <= EXACT:
            break
    if best is not None:
        return best[1]
    if farthest is None:
        raise UserCodeError(f"nothing was tried ({tried})")
    raise UserCodeError(f"fits no known convention ({tried}); nearest to one, {reason_of(farthest[1])}") from farthest[
        1
    ]
