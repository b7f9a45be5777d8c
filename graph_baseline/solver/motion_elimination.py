"""Elimination of poses without observations, in closed form.

Products of matrices F_k = [I, f_k; 0, 1] are sums of levers: the error is propagated from pose j to pose b by
[I, e_jb; 0, 1] with e_jb = f_j + ... + f_{b-1}. The steps from one scan to the next are therefore combined to one step
without a recursion, and the poses between the scans are affine maps of the poses with scans.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.covariances import without_negative_eigenvalues
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, rotation


class Between(NamedTuple):
    """The J poses without observations, in increasing order; pose j is between the keys a and b."""

    pose: Int  # (J,) number of pose j
    key: Int  # (J,) index of key b
    lever_from: Float  # (J, 2) e_aj
    lever_to: Float  # (J, 2) e_jb
    c: Float  # (J, 3) sum of the steps from a to j
    W: Float  # (J, 3, 3) covariance of the noise of these steps


class Chain(NamedTuple):
    """A linear model on the key poses: the first pose, the last, and all with observations."""

    model: LinearModel  # `step` contains indices of keys
    key: Int  # (K,) numbers of the key poses
    between: Between


def eliminate_motions(model: LinearModel) -> Chain:
    """Return the model without the poses that have no observations; this is exact."""
    steps = len(model.F)
    key = np.union1d(model.step, [0, steps])
    if len(key) == steps + 1:
        none = np.zeros(0, dtype=np.int64)
        return Chain(model, key, Between(none, none, *(np.zeros((0, *shape)) for shape in ((2,), (2,), (3,), (3, 3)))))
    segment = np.searchsorted(key, np.arange(1, steps + 1)) - 1  # segment of the step to pose 1, 2, ...
    lever = sums_within(segment, key, model.F[:, :2, 2])  # (N, 2): from the previous key to pose 1, 2, ...
    c = _carried(segment, key, lever, model.c)
    W = propagated_covariances(segment, key, lever, model.W)
    last = key[1:] - 1  # the steps that lead to keys
    F = np.tile(np.eye(3), (len(last), 1, 1))
    F[:, :2, 2] = lever[last]
    short = model._replace(F=F, c=c[last], W=W[last], step=np.searchsorted(key, model.step))
    rows = np.setdiff1d(np.arange(steps), last)
    after = segment[rows]
    return Chain(
        short, key, Between(rows + 1, after + 1, lever[rows], lever[last[after]] - lever[rows], c[rows], W[rows])
    )


def sums_within(segment: Int, key: Int, rows: Float) -> Float:
    """Return running sums (N, ...) of the rows (N, ...) that restart at every key."""
    total = np.concatenate([np.zeros((1, *rows.shape[1:])), np.cumsum(rows, axis=0)])
    return total[1:] - total[key[segment]]


def _carried(segment: Int, key: Int, lever: Float, c: Float) -> Float:
    """Return the sums (N, 3) of the steps since the last key, at pose 1, 2, ...: the sum of [I, e_kj; 0, 1] c_k."""
    sums = sums_within(segment, key, c)
    sums[:, :2] += lever * sums[:, 2:] - sums_within(segment, key, lever * c[:, 2:])
    return sums


def propagated_covariances(segment: Int, key: Int, lever: Float, W: Float) -> Float:
    """Return covariances (N, 3, 3) since the last key: the sum of [I, e_kj; 0, 1] W_k [I, e_kj; 0, 1]'.

    With e_kj = lever_j - lever_k it is a polynomial in lever_j, whose coefficients are running sums.
    """
    back = W.copy()  # propagated back to the key
    shear(back, -lever)
    sums = sums_within(segment, key, back)
    shear(sums, lever)
    return sums


def shear(P: Float, lever: Float) -> None:
    """Apply P <- [I, e; 0, 1] P [I, e; 0, 1]' in place, for P (n, 3, 3) and e (n, 2)."""
    P[:, :2, :] += lever[:, :, None] * P[:, 2:, :]
    P[:, :, :2] += lever[:, None, :] * P[:, :, 2:]


def reduce_to_key_poses(recording: Problem) -> tuple[Problem, Int]:
    """Return the recording with a single motion from each key pose to the next, and the numbers (K,) of these poses.

    The covariances are propagated along the measured path, which is correct to first order in the noise.
    """
    steps = recording.steps
    key = np.union1d(recording.observation_step, [0, steps])
    if len(key) == steps + 1:
        return recording, key
    path = chain([0.0, 0.0, 0.0], recording.odometry)
    segment = np.searchsorted(key, np.arange(1, steps + 1)) - 1
    moved = np.diff(path[:, :2], axis=0)
    lever = sums_within(segment, key, np.column_stack([-moved[:, 1], moved[:, 0]]))
    turn = np.zeros((steps, 3, 3))
    turn[:, :2, :2], turn[:, 2, 2] = rotation(path[1:, 2]), 1.0
    noise = propagated_covariances(segment, key, lever, turn @ recording.odometry_cov @ turn.swapaxes(1, 2))
    last = key[1:] - 1
    short = replace(
        recording,
        stamps=recording.stamps[key],
        odometry=between(path[key[:-1]], path[key[1:]]),
        odometry_cov=without_negative_eigenvalues(turn[last].swapaxes(1, 2) @ noise[last] @ turn[last]),
        observation_step=np.searchsorted(key, recording.observation_step),
    )
    return short, key


def restore_poses(recording: Recording, key: Int, poses: Float) -> Float:
    """Return poses (N+1, 3) from key poses (K, 3); the others follow the odometry from the previous key pose."""
    path = chain([0.0, 0.0, 0.0], recording.odometry)
    at = np.searchsorted(key, np.arange(len(path)), side="right") - 1
    full = compose(poses[at], between(path[key[at]], path))
    full[key] = poses
    return full
