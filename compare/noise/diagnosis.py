"""Tests of assumed noise by the innovations of a log.

A score is an innovation over its standard deviation. If the noise is right, scores are independent and standard normal.
Then the mean of their squares, the NIS per row, is 1, their quantiles are those of the normal distribution, and
successive scores of a landmark are not correlated.

A channel is a sensor component with its own noise: range, bearing, or both coordinates of a position.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from slamgauge.arrays import Float, Int
from slamgauge.compare.noise.likelihood import NoiseModel
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import LEVEL
from slamgauge.ekf.innovations import Innovations

QUANTILES = 101  # number of quantiles, evenly spaced on the axis of the normal distribution
LAGS = 10  # largest lag of a correlation, in observations of a landmark


class Nis(NamedTuple):
    """Mean of the squares of `rows` scores, expected to be 1 if the noise is right, and its 95 % band."""

    mean: float | None
    low: float | None
    high: float | None
    rows: int


class Correlation(NamedTuple):
    """Correlation (LAGS,) of scores of a landmark 1, 2, ... observations apart, and the 95 % limit of the first."""

    by_lag: Float
    band: float


@dataclass(frozen=True)
class Diagnosis:
    """Scores (M, 2) of a log, NaN without information, and their statistics by channel."""

    scores: Float
    by_channel: dict[str, Float] = field(default_factory=dict[str, Float])  # (n,) without NaN
    nis: dict[str, Nis] = field(default_factory=dict[str, Nis])
    nis_by_landmark: dict[str, dict[int, Nis]] = field(default_factory=dict[str, dict[int, Nis]])
    correlation: dict[str, Correlation] = field(default_factory=dict[str, Correlation])


def diagnose(model: NoiseModel, innovations: Innovations) -> Diagnosis:
    """Return scores and statistics of the innovations of a model."""
    ids = model.recording.landmark
    assert ids is not None  # a noise model has ids
    result = Diagnosis(innovations.value / np.sqrt(innovations.variance))
    for channel in model.parameters.channels:
        scores = result.scores[:, model.parameters.rows(channel)]
        defined = ~np.isnan(scores[:, 0])
        found, seen = scores[defined], ids[defined]
        result.by_channel[channel] = found.ravel()
        result.nis[channel] = nis_of(found)
        result.nis_by_landmark[channel] = {int(each): nis_of(found[seen == each]) for each in np.unique(seen)}
        result.correlation[channel] = autocorrelation(found, seen)
    return result


def nis_of(scores: Float) -> Nis:
    """Return the NIS of scores of any shape."""
    if not scores.size:
        return Nis(None, None, None, 0)
    low, high = chi2_band(LEVEL, scores.size)
    return Nis(float(np.mean(scores**2)), low / scores.size, high / scores.size, scores.size)


def normal_quantiles(count: int) -> Float:
    """Return evenly spaced normal quantiles (QUANTILES,), up to about the largest of `count` normal scores."""
    reach = -ndtri(0.5 / count)
    return np.linspace(-reach, reach, QUANTILES)


def quantiles(scores: Float, expected: Float) -> Float:
    """Return quantiles of scores (n,) at the cumulative probabilities of the normal quantiles `expected`."""
    return np.quantile(scores, ndtr(expected), method="hazen")


def autocorrelation(scores: Float, ids: Int) -> Correlation:
    """Return the correlation of scores (n, d) of the same landmark, with ids (n,), in the order of the recording.

    The mean product of the pairs is divided by the mean square of all scores. No mean is subtracted, because an offset
    is not white noise.
    """
    order = np.argsort(ids, kind="stable")
    scores, ids = scores[order], ids[order]
    power = max(float(np.mean(scores**2)), 1e-300) if len(scores) else 1.0
    products = [(scores[lag:] * scores[:-lag])[ids[lag:] == ids[:-lag]] for lag in range(1, LAGS + 1)]
    by_lag = np.array([each.mean() / power if each.size else 0.0 for each in products])
    return Correlation(by_lag, 1.96 / max(products[0].size, 1) ** 0.5)
