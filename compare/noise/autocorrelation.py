"""Correlated errors: how many successive observations of a landmark have the information of one.

If successive errors have the correlation r, like those of a first-order autoregressive process, the mean of many errors
is as uncertain as that of (1 - r) / (1 + r) times as many independent ones (Bayley and Hammersley, Journal of the Royal
Statistical Society, Supplement, 8(2), 1946). The filter of a moving robot forgets an observation with every step of
odometry. If it keeps a share m of its information from scan to scan, weights decrease as m^k, and

    (1 + r m) / (1 - r m)

observations count as one. In the steady state a scan adds the information that the motion since the last scan removed:
if it adds I nats to the three entries of the pose, m = exp(-2 I / 3). I depends on the assumed noise, and the noise on
m, so both are computed in turn.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slamgauge.compare.noise.diagnosis import Diagnosis
from slamgauge.compare.noise.innovation_model import NoiseModel

NEGLIGIBLE = 0.05  # a smaller correlation changes no interval by more than 5 %
ROUNDS = 30  # largest number of rounds; about 5 are needed
SETTLED = 0.01  # relative change that ends the rounds


def largest_correlation(diagnosis: Diagnosis) -> float:
    """Return the largest correlation of successive scores of a landmark over all channels; 0 if none is significant."""
    first = {channel: float(each[0]) for channel, each in diagnosis.correlation.items()}
    return max((r for name, r in first.items() if r > max(diagnosis.correlation_band[name], NEGLIGIBLE)), default=0.0)


def observations_per_independent_one(model: NoiseModel, values: Mapping[str, float], correlation: float) -> float:
    """Return how many observations of a landmark count as one, for a correlation of successive errors."""
    counted = 1.0
    for _ in range(ROUNDS):
        kept = correlation * _kept_share(model, with_larger_sigmas(model, values, counted))
        previous, counted = counted, (1.0 + kept) / (1.0 - kept)
        if abs(counted / previous - 1.0) < SETTLED:
            break
    return counted


def with_larger_sigmas(model: NoiseModel, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return the values with covariances of observations that are multiplied by `factor`."""
    return {**values, **{channel: values[channel] * factor**0.5 for channel in model.parameters.channels}}


def _kept_share(model: NoiseModel, values: Mapping[str, float]) -> float:
    """Return the share of its information about the pose that the filter keeps from scan to scan."""
    innovations = model.innovations(values)
    if innovations is None:
        return 0.0
    own = np.diagonal(model.parameters.measurements(values).observation_cov, axis1=1, axis2=2)
    gained = 0.5 * np.nansum(np.log(innovations.variance / own))
    scans = len(np.unique(model.recording.observation_step))
    return float(np.exp(-2.0 * gained / (3 * scans)))
