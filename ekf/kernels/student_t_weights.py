"""Weights of observations with heavy-tailed noise, compiled.

Student's t distribution with n degrees of freedom is a normal distribution whose covariance R / w is drawn for each
observation; w has the Gamma distribution with parameters n/2, n/2. Given the squared distance d2 of an observation with
d rows, the expectation of w is (n + d) / (n + d2). With this w the update is a Kalman update. The distance uses the
innovation covariance S = H P H' + R, so that an observation of an uncertain landmark is not treated as an outlier. The
weight is limited to 1: the covariance of an observation is never smaller than R, and an update without outliers is
conservative.

Sources: Lange, Little and Taylor, Journal of the American Statistical Association 84(408), 1989 (the weights);
Agamennoni, Nieto and Nebot, IEEE Transactions on Signal Processing 60(10), 2012 (in a Kalman filter); Chang, Journal of
Geodesy 88(4), 2014 (by the innovation's Mahalanobis distance).
"""

from __future__ import annotations

from slamgauge.arrays import Float, Int
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.covariance import squared_distance
from slamgauge.ekf.kernels.linearisation import innovations_of
from slamgauge.jit import inner, kernel
from slamgauge.sensor_kernels import DIM


@inner
def inflation(sensor: int, distance: float, freedom: float) -> float:
    """Return 1 / w of an observation at a squared Mahalanobis distance, for `freedom` degrees of freedom."""
    return max(1.0, (freedom + distance) / (freedom + DIM[sensor]))


@kernel
def inflate_noise(sensor: int, belief: Belief, slots: Int, values: Float, covs: Float, freedom: float) -> None:
    """R <- R / w in `covs` (m, 2, 2) for observations (m, 2) of the landmarks in `slots` (m,)."""
    innovation, S = innovations_of(sensor, belief, slots, values, covs)
    for i in range(len(slots)):
        v = innovation[2 * i : 2 * i + 2]
        distance = squared_distance(v[0], v[1], S[i, 0, 0], S[i, 0, 1], S[i, 1, 1])
        covs[i] *= inflation(sensor, distance, freedom)
