"""Errors that last: a landmark's successive sights err alike, and a filter that takes them for new ones is too sure.

Where successive errors correlate by r, as those of a first-order autoregressive process, the mean of many is as
uncertain as that of (1 - r) / (1 + r) times as many independent ones (Bayley and Hammersley, Journal of the Royal
Statistical Society, Supplement, 8(2), 1946). A filter of a moving robot does not average for ever: it forgets a sight
with every step of odometry. Where it keeps a share m of what it knows from scan to scan, weights fall as m^k, and

    (1 + r m) / (1 - r m)

sights count as one. In the steady state a scan brings what the motion since the last one took: with I nats gained in
the three entries of the pose, m = exp(-2 I / 3). What is gained depends on the noise told: both are found in turn.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from slamgauge.compare.noise.diagnosis import Diagnosis
from slamgauge.compare.noise.innovation_model import NoiseModel

WORTH_SAYING = 0.05  # of a correlation: less changes no interval by more than 5 %
ROUNDS = 30  # at most; some 5 are taken
SETTLED = 0.01  # share by which a round may change what is found
POSE = 3  # entries


def lasting(diagnosis: Diagnosis) -> float:
    """The largest correlation of a landmark's successive scores among all channels; 0 where none is worth a word."""
    first = {channel: float(each[0]) for channel, each in diagnosis.correlation.items()}
    return max((r for name, r in first.items() if r > max(diagnosis.correlation_band[name], WORTH_SAYING)), default=0.0)


def sights_counted_as_one(model: NoiseModel, values: Mapping[str, float], correlation: float) -> float:
    """How many sights of a landmark count as one, for errors that correlate so from one to the next."""
    counted = 1.0
    for _ in range(ROUNDS):
        kept = correlation * _kept(model, larger(model, values, counted))
        previous, counted = counted, (1.0 + kept) / (1.0 - kept)
        if abs(counted / previous - 1.0) < SETTLED:
            break
    return counted


def larger(model: NoiseModel, values: Mapping[str, float], counted: float) -> dict[str, float]:
    """The values with covariances of observations that are so many times larger."""
    return {**values, **{channel: values[channel] * counted**0.5 for channel in model.channels}}


def _kept(model: NoiseModel, values: Mapping[str, float]) -> float:
    """Share of what the filter knows of the pose that it keeps from scan to scan, under this noise."""
    innovations = model.under(values)
    if innovations is None:
        return 0.0
    own = np.diagonal(model.told.measurements(values).observation_cov, axis1=1, axis2=2)
    gained = 0.5 * np.nansum(np.log(innovations.variance / own))
    scans = len(np.unique(model.recording.observation_step))
    return float(np.exp(-2.0 * gained / (POSE * scans)))
