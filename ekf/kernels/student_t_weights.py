"""Weights of observations whose noise may have heavy tails, compiled.

Noise of Student's distribution is Gauss's with a precision that is drawn for each observation: R / w, where w has the
Gamma distribution of n/2, n/2. Given a squared distance d2 of an observation of d rows, the expectation of w is
(n + d) / (n + d2): with it the update is a Kalman update. The distance is taken by the innovation's own covariance
S = H P H' + R, so that what the map does not know well is not taken for an outlier, and w is never above 1: no
observation is trusted more than its covariance says, and an update that meets no outlier stays on the safe side.

Sources: Lange, Little and Taylor, Journal of the American Statistical Association 84(408), 1989 (the weights);
Agamennoni, Nieto and Nebot, IEEE Transactions on Signal Processing 60(10), 2012 (in a Kalman filter); Chang, Journal of
Geodesy 88(4), 2014 (by the innovation's Mahalanobis distance).
"""

from __future__ import annotations

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief
from slamgauge.ekf.kernels.covariance import squared_distance
from slamgauge.ekf.kernels.linearisation import describe
from slamgauge.ekf.kernels.workspace import Workspace
from slamgauge.jit import kernel
from slamgauge.sensor_kernels import DIM


@kernel
def inflation(sensor: int, distance: float, freedom: float) -> float:
    """1 / w of an observation at a squared Mahalanobis distance, for noise of `freedom` degrees of freedom."""
    return max(1.0, (freedom + distance) / (freedom + DIM[sensor]))


@kernel
def weigh(sensor: int, belief: Belief, count: int, work: Workspace, S: Float, freedom: float) -> None:
    """R <- R / w for the first `count` observations in `work`; S (m, 2, 2) is room to work in."""
    describe(sensor, belief, count, work, S)
    for i in range(count):
        v = work.innovation[2 * i : 2 * i + 2]
        distance = squared_distance(v[0], v[1], S[i, 0, 0], S[i, 0, 1], S[i, 1, 1])
        work.observation_cov[i] *= inflation(sensor, distance, freedom)
