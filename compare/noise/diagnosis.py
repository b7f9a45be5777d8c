"""Tests of assumed noise by the innovations of a log.

Each component of an innovation, for example its range, has a normal score: the value with the same cumulative
probability in the standard normal distribution as the component has in its assumed distribution. If noise and
distribution are right, scores are independent and standard normal. Then the mean of their squares, the NIS per row, is
1, their quantiles are those of the normal distribution, and successive scores of a landmark are not correlated.

A channel is a sensor component with its own noise: range, bearing, or both coordinates of a position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp, stdtr

from slamgauge.arrays import Float, Int
from slamgauge.compare.noise.innovation_model import ErrorDistribution, NoiseModel
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.ekf.innovations import Innovations

LEVEL = 0.95
QUANTILES = 101  # number of quantiles, evenly spaced on the axis of the normal distribution
LAGS = 10  # largest lag of a correlation, in observations of a landmark
SMALLEST = -700.0  # logarithm of the smallest probability


class Nis(NamedTuple):
    """Mean of the squares of `rows` normal scores, expected to be 1 if the noise is right, and its 95 % band."""

    mean: float
    low: float
    high: float
    rows: int


class Diagnosis(NamedTuple):
    """Normal scores of a log, and their statistics by channel."""

    scores: dict[str, Float]  # (n,) in the order of the recording
    nis: dict[str, Nis]
    nis_by_landmark: dict[str, dict[int, Nis]]  # keys are channels, then ids
    correlation: dict[str, Float]  # (LAGS,) of scores of a landmark 1, 2, ... observations apart
    correlation_band: dict[str, float]  # 95 % limit of the first correlation of white scores


def diagnose(model: NoiseModel, innovations: Innovations, values: dict[str, float]) -> Diagnosis:
    """Return scores and statistics of `innovations`, which were computed with the noise parameters `values`."""
    ids = model.recording.landmark
    assert ids is not None  # a noise model has ids
    distributions = {each.channel: each for each in model.distributions if each.parameters[0] in values}
    result = Diagnosis({}, {}, {}, {}, {})
    for channel in model.parameters.channels:
        rows = model.rows(channel)
        scores = normal_scores(
            innovations.value[:, rows], innovations.variance[:, rows], distributions.get(channel), values
        )
        defined = ~np.isnan(scores[:, 0])
        found, seen = scores[defined], ids[defined]
        result.scores[channel] = found.ravel()
        result.nis[channel] = nis_of(result.scores[channel])
        result.nis_by_landmark[channel] = {int(each): nis_of(found[seen == each]) for each in np.unique(seen)}
        result.correlation[channel], pairs = autocorrelation(found, seen)
        result.correlation_band[channel] = 1.96 / max(pairs, 1) ** 0.5
    return result


def nis_of(scores: Float) -> Nis:
    """Return the NIS of normal scores of any shape; its numbers are NaN without scores."""
    if not scores.size:
        return Nis(np.nan, np.nan, np.nan, 0)
    low, high = chi2_band(LEVEL, scores.size)
    return Nis(float(np.mean(scores**2)), low / scores.size, high / scores.size, scores.size)


def normal_scores(
    errors: Float, variances: Float, distribution: ErrorDistribution | None, values: dict[str, float]
) -> Float:
    """Return the normal scores of innovations, in the same shape.

    Args:
        errors: innovations of one channel.
        variances: their variances, without the additional variance of outliers.
        distribution: distribution of the channel's errors; None if it is Gaussian.
        values: noise parameters by name.
    """
    z = errors / np.sqrt(variances)
    if distribution is None:
        return z
    size, channel = np.abs(z), distribution.channel
    if distribution.kind == "student-t":
        with np.errstate(divide="ignore"):
            tail = np.log(stdtr(values[f"{channel} dof"], -size))
    else:
        rate, spread = values[f"{channel} rate"], values[f"{channel} spread"]
        wide = np.abs(errors) / np.sqrt(variances + spread**2)
        with np.errstate(invalid="ignore"):  # some rows are NaN
            tail = np.logaddexp(np.log1p(-rate) + log_ndtr(-size), np.log(rate) + log_ndtr(-wide))
    return -np.sign(z) * ndtri_exp(np.maximum(tail, SMALLEST))


def normal_quantiles(count: int) -> Float:
    """Return evenly spaced normal quantiles (QUANTILES,), up to about the largest of `count` normal scores."""
    reach = -ndtri(0.5 / count)
    return np.linspace(-reach, reach, QUANTILES)


def quantiles(scores: Float, expected: Float) -> Float:
    """Return quantiles of scores (n,) at the cumulative probabilities of the normal quantiles `expected`."""
    return np.quantile(scores, ndtr(expected), method="hazen")


def autocorrelation(scores: Float, ids: Int) -> tuple[Float, int]:
    """Return the autocorrelation (LAGS,) of scores at lags 1, 2, ..., and the number of pairs with lag 1.

    A pair is two scores of the same landmark. The mean product of the pairs is divided by the mean square of all
    scores. No mean is subtracted, because an offset is not white noise.

    Args:
        scores: (n, d) in the order of the recording.
        ids: (n,) landmark of each row.
    """
    order = np.argsort(ids, kind="stable")
    scores, ids = scores[order], ids[order]
    power = max(float(np.mean(scores**2)), 1e-300) if len(scores) else 1.0
    products = [(scores[lag:] * scores[:-lag])[ids[lag:] == ids[:-lag]] for lag in range(1, LAGS + 1)]
    return np.array([each.mean() / power if each.size else 0.0 for each in products]), products[0].size
