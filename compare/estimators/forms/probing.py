"""Search for the way in which user code is called: a tiny recording with a known answer, tried with each way.

The recording has no noise, so that a right filter returns the true state, whatever noise it assumes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.captured_output import discarded
from slamgauge.compare.estimators.forms.state_log import StateLog, Steps
from slamgauge.compare.estimators.user_code import UserCodeError, reason_of, user_frames
from slamgauge.ekf import textbook  # it loads no compiler, which would slow down the start of processes
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation, wrap
from slamgauge.sensors import predict

START = np.array([1.0, -0.5, 1.2])
MOVES = np.array([[0.5, 0.0, 0.1], [0.4, 0.0, -0.2], [0.6, 0.0, 0.15], [0.3, 0.0, 0.05]])
LANDMARKS = np.array([[5.0, 1.0], [4.0, 4.0], [7.0, -1.0], [2.0, 3.0]])
OBSERVED = np.array([[1, 0], [1, 3], [2, 3], [2, 1], [2, 0], [2, 2], [3, 1], [4, 2], [4, 0]])  # steps and ids
ORDER = [0, 3, 1, 2]  # ids in the order of first observation
MOVE_SIGMA, TURN_SIGMA = 0.02, 0.01  # [m], [rad]
RIGHT = 0.1  # largest error of a pose [m, rad] or a landmark [m] of a right way
MARGIN = 0.7  # a later way is kept if its log sigma ratio is smaller by this
UNMAPPED = 10.0  # error [m] of a map with a wrong number of landmarks

W = TypeVar("W")


def tiny_recording(step_s: float) -> Recording:
    """Return a recording of four steps with exact increments and observations of the ids 0 to 3.

    The heading is far from both axes, so that noise in the world frame differs from noise in the body frame. Sigmas of
    observations are ten times smaller than those of speed and yaw rate, so that these cannot be mixed up.

    Args:
        step_s: time between poses [s].
    """
    steps, ids = OBSERVED.T
    poses = right_poses()[steps]
    offset = np.einsum("mji,mj->mi", rotation(poses[:, 2]), LANDMARKS[ids] - poses[:, :2])
    sigmas = np.array([MOVE_SIGMA, TURN_SIGMA]) / (10.0 * step_s)
    return Recording(
        stamps=step_s * np.arange(len(MOVES) + 1.0),
        prior_mean=START,
        prior_cov=np.diag([1e-4, 2e-4, 1e-4]),
        odometry=MOVES,
        odometry_cov=np.diag([MOVE_SIGMA**2, 0.0, TURN_SIGMA**2]),
        sensor="range-bearing",
        observation_step=steps,
        observation=predict("range-bearing", offset),
        observation_cov=np.diag(sigmas**2),
        landmark=ids,
    )


def right_poses() -> Float:
    """Return the true path (5, 3)."""
    return chain(START, MOVES)


def best_of(
    ways: Iterable[W], started: Callable[[W], Steps], recording: Recording, *, is_blind: bool = False, given: str = ""
) -> W:
    """Return the first way with a right estimate, else that with the smallest error.

    Args:
        ways: ways to call user code, the most usual first.
        started: starts user code in a way on the recording.
        recording: a tiny recording.
        is_blind: whether observations are not used; then all ways are tried, and sigmas are compared with those of dead
            reckoning, too.
        given: what the code receives, for the error message.

    Raises:
        UserCodeError: all ways raise errors; its reason is that of the way that came farthest.
    """
    best: tuple[float, float, W] | None = None
    farthest: tuple[tuple[int, float], Exception] | None = None
    number = 0
    for number, way in enumerate(ways, 1):  # noqa: B007 counts them
        log = StateLog(recording)
        try:
            with discarded():
                estimate = log.run(started(way))
        except Exception as raised:  # noqa: BLE001 whatever user code raises
            reached = log.steps, _last_line(raised)
            if farthest is None or reached > farthest[0]:
                farthest = reached, raised
            continue
        error = max(_pose_error(estimate), 0.0 if is_blind else _map_error(estimate, recording))
        error = 0.0 if error < RIGHT else error
        ratio = _sigma_ratio(estimate, recording) if is_blind else 0.0
        if best is None or error < best[0] or (error == best[0] and ratio + MARGIN < best[1]):
            best = error, ratio, way
        if error == 0.0 and not is_blind:
            break
    if best is not None:
        return best[2]
    if farthest is None:
        raise UserCodeError("no way to call it is known; give a callable of a known form")
    if number == 1:
        raise farthest[1]
    reason = "; ".join([*filter(None, (reason_of(farthest[1]), given))])
    raise UserCodeError(f"fits none of {number} known ways to call it; nearest to one, {reason}") from farthest[1]


def follows_arc(steps: Steps, recording: Recording) -> bool:
    """Return whether user code that uses no observations moves on an arc in each step, or on nearly one."""
    move, turn = MOVES[:, 0], MOVES[:, 2]
    arcs = np.column_stack([move * np.sin(turn) / turn, move * (1 - np.cos(turn)) / turn, turn])
    with discarded():
        poses = StateLog(recording).run(steps).poses
    return bool(np.abs(poses - chain(START, arcs)).max() < np.abs(poses - right_poses()).max())


def _last_line(error: Exception) -> float:
    """Return the number of the last line of user code; infinite if the code returned and its results are refused."""
    return max((each.lineno or 0 for each in user_frames(error.__cause__ or error)[-1:]), default=np.inf)


def _pose_error(estimate: Estimate) -> float:
    error = estimate.poses - right_poses()
    return float(np.abs([error[:, 0], error[:, 1], wrap(error[:, 2])]).max())


def _map_error(estimate: Estimate, recording: Recording) -> float:
    """Return the largest error of a coordinate [m]; without ids landmarks are in the order of first observation."""
    if len(estimate.landmarks) != len(LANDMARKS):
        return UNMAPPED
    order = ORDER if recording.landmark is None else estimate.landmark_ids
    return float(np.abs(estimate.landmarks - LANDMARKS[order]).max())


def _sigma_ratio(estimate: Estimate, recording: Recording) -> float:
    """Return the largest absolute logarithm of a last sigma over that of dead reckoning."""
    belief = textbook.Belief(recording.prior_mean, recording.prior_cov, ())
    for increment, cov in zip(recording.odometry, recording.odometry_cov, strict=True):
        belief = textbook.predict(belief, increment, cov)
    mine, right = np.diagonal(np.asarray(estimate.pose_covs)[-1]), np.diagonal(belief.P)
    return float(np.abs(np.log(np.maximum(mine, 1e-18) / right)).max() / 2)
