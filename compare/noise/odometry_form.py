"""How a recording's odometry noise varies from step to step, apart from how large it is.

Q_k = T_k diag(forward^2, lateral^2, turn^2) T_k', body frame at the start of the step, where T_k has ones on its
diagonal and says how much of one error is seen in another: what sits ahead of the robot's centre moves sideways when it
turns. Q_k is split so by elimination, the turn first, then lateral, then forward: the noise of the turn is all of it,
the lateral one what the turn does not explain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float

PIVOT = 1e-9  # share of a variance that is more than the rounding of its elimination


class OdometryForm(NamedTuple):
    """The form of N covariances; forward, lateral and turn in this order."""

    mixing: Float  # (N, 3, 3) T_k
    profile: Float  # (N, 3) sigmas of each step, over their root mean square
    assumed: Float  # (3,) that root mean square [m, m, rad per step]

    def covariances(self, sigmas: Float) -> Float:
        """(N, 3, 3) of the same form, with other sigmas (3,)."""
        mixed = self.mixing * (self.profile * sigmas)[:, None, :]
        return mixed @ mixed.swapaxes(1, 2)


def odometry_form(covs: Float) -> OdometryForm:
    """The form of covariances (N, 3, 3); a sigma that is 0 in all of them varies as forward does, or not at all."""
    turn = covs[:, 2, 2]
    lateral_by_turn, forward_by_turn = _share(covs[:, 1, 2], turn), _share(covs[:, 0, 2], turn)
    lateral = _left(covs[:, 1, 1], lateral_by_turn**2 * turn)
    forward_by_lateral = _share(covs[:, 0, 1] - lateral_by_turn * forward_by_turn * turn, lateral)
    forward = _left(covs[:, 0, 0], forward_by_turn**2 * turn + forward_by_lateral**2 * lateral)
    mixing = np.tile(np.eye(3), (len(covs), 1, 1))
    mixing[:, 0, 1], mixing[:, 0, 2] = forward_by_lateral, forward_by_turn
    mixing[:, 1, 2] = lateral_by_turn
    sigmas = np.sqrt(np.column_stack([forward, lateral, turn]))
    assumed = np.sqrt(np.mean(sigmas**2, axis=0)) if len(covs) else np.zeros(3)
    profile = np.ones_like(sigmas)
    for column in range(3):
        source = column if assumed[column] > 0.0 else 0
        if assumed[source] > 0.0:
            profile[:, column] = sigmas[:, source] / assumed[source]
    return OdometryForm(mixing, profile, assumed)


def _share(shared: Float, variance: Float) -> Float:
    """Regression of one error on another of that variance; 0 where it has none."""
    return np.divide(shared, variance, out=np.zeros_like(shared), where=variance > 0.0)


def _left(variance: Float, explained: Float) -> Float:
    """What is left of a variance, 0 where that is rounding."""
    left = variance - explained
    return np.where(left > PIVOT * variance, left, 0.0)
