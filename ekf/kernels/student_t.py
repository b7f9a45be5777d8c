"""Weights of observations whose noise has Student's t distribution, compiled.

With n degrees of freedom it is a normal distribution whose covariance R / w is drawn for each observation; w has a
Gamma distribution with parameters n/2, n/2. Given the squared distance d2 of an observation with d rows, the
expectation of w is (n + d) / (n + d2). With this w the update is a Kalman update. The distance uses S = H P H' + R:
an observation of an uncertain landmark is not treated as an outlier. The weight is at most 1: an update without
outliers is conservative. Sources: Lange, Little and Taylor, Journal of the American Statistical Association 84(408),
1989; Agamennoni, Nieto and Nebot, IEEE Transactions on Signal Processing 60(10), 2012; Chang, Journal of Geodesy
88(4), 2014 (by the Mahalanobis distance of the innovation).
"""

from __future__ import annotations

from slamgauge.arrays import Float
from slamgauge.ekf.kernels.belief import Belief, Workspace
from slamgauge.ekf.kernels.covariance import squared_distance
from slamgauge.ekf.kernels.linearisation import innovations_of
from slamgauge.formula_kernels import DIM
from slamgauge.jit import inner, kernel


@kernel
def inflate_noise(sensor: int, belief: Belief, count: int, freedom: float, work: Workspace) -> None:
    """R <- R / w for the first `count` observations of `work`."""
    slots, values, covs = work.slots[:count], work.observation[:count], work.observation_cov[:count]
    innovation, S = innovations_of(sensor, belief, slots, values, covs)
    for i in range(count):
        v0, v1 = innovation[2 * i], innovation[2 * i + 1]
        inflate(sensor, squared_distance(v0, v1, S[i, 0, 0], S[i, 0, 1], S[i, 1, 1]), freedom, covs[i])


@inner
def inflate(sensor: int, distance: float, freedom: float, R: Float) -> None:
    """R <- R / w for the covariance R (2, 2) of an observation at a squared Mahalanobis distance."""
    factor = max(1.0, (freedom + distance) / (freedom + DIM[sensor]))
    for a in range(2):  # numba compiles loops faster than operations on slices, with their error messages
        for b in range(2):
            R[a, b] *= factor
