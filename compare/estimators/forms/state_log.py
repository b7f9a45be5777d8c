"""Log of a filter that returns its whole state after every step, and the estimate made from it."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.validation import REAL


class StateLog:
    """Poses, covariances and map of a filter with the state (3+2n,): robot, then landmarks as they were mapped.

    With known association the n-th landmark of the state has the id that was observed n-th. If a filter maps otherwise
    (several members for a landmark, duplicates, no landmarks at first), ids are unknown, and the estimate has no map.

    Args:
        recording: the input of the filter.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._ids: list[int] = []
        self._is_named = True
        self._poses = [recording.prior_mean]
        self._covs = [recording.prior_cov]
        self._seconds = [0.0]
        self._state, self._cov = self._poses[0], self._covs[0]

    def add(self, number: int, returned: tuple[object, object], ids: Int | None, seconds: float) -> None:
        """Log a step.

        Args:
            number: number of the step, one above that of the last call, or 0.
            returned: state and covariance after the step.
            ids: (m,) ids of its observations; None if they are unknown.
            seconds: computing time.

        Raises:
            UserCodeError: state and covariance have wrong or different sizes, or are not finite.
        """
        self._state, self._cov = _checked(number, *returned)
        del self._poses[number:], self._covs[number:], self._seconds[number:]
        self._poses.append(self._state[:3])
        self._covs.append((self._cov[:3, :3] + self._cov[:3, :3].T) / 2)
        self._seconds.append(seconds)
        count = (len(self._state) - 3) // 2
        if ids is None:
            self._ids = [*range(count)]
            self._is_named = self._recording.landmark is None  # otherwise 0, 1, ... would be read as its ids
        else:
            self._ids += [name for name in dict.fromkeys(ids.tolist()) if name not in self._ids]
            self._is_named = self._is_named and len(self._ids) == count

    def estimate(self) -> Estimate:
        """Return the logged poses with the last map."""
        ids = np.array(self._ids if self._is_named else [], dtype=np.int64)
        ends = 3 + 2 * np.arange(len(ids))
        covs = np.array([self._cov[at : at + 2, at : at + 2] for at in ends]).reshape(-1, 2, 2)
        is_whole = self._recording.landmark is not None and np.isin(self._recording.landmark, ids).all()
        return Estimate(
            kind="filtered",
            poses=np.array(self._poses),
            pose_covs=np.array(self._covs),
            landmark_ids=ids,
            landmarks=self._state[3 : 3 + 2 * len(ids)].reshape(-1, 2),
            landmark_covs=(covs + covs.swapaxes(1, 2)) / 2,
            association=self._recording.landmark if is_whole else None,
            seconds=np.array(self._seconds),
        )


def _checked(number: int, state: object, cov: object) -> tuple[Float, Float]:
    """Return copies (3+2n,) and (3+2n, 3+2n), whatever shape the state has."""
    x, P = _array(state), _array(cov)
    size = x.size
    if size < 3 or not size % 2 or P.shape != (size, size):
        what = f"xEst {x.shape} and PEst {P.shape}"
        raise UserCodeError(f"step {number}: returned {what}; return (3+2n, 1) and (3+2n, 3+2n)")
    for name, array in (("xEst", x), ("PEst", P)):
        if not np.isfinite(array).all():
            raise UserCodeError(f"step {number}: {name} is not finite from here on; look for what divides by zero")
    return x.reshape(-1), P


def _array(value: object) -> Float:
    """Copy an array of real numbers; return an empty array for anything else."""
    try:
        given = np.asarray(value)
    except ValueError:
        return np.zeros(0)
    return given.astype(np.float64) if given.dtype.kind in REAL else np.zeros(0)
