"""What the innovations of a log say of the noise that was assumed.

A normal score is the innovation of a row, taken through its own distribution to the standard normal one. Under the
right noise and the right law, scores are independent and standard normal, whatever that law is: their squares are the
NIS of a row, their quantiles those of the normal distribution, and successive ones of a landmark are not correlated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp, stdtr

from slamgauge.arrays import Float, Int
from slamgauge.compare.noise.innovation_model import Law, NoiseModel
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.ekf.innovations import Innovations

LEVEL = 0.95
QUANTILES = 101  # of scores, evenly spaced in those of the normal distribution
LAGS = 10  # sights of a landmark over which its scores may be correlated
BEYOND = -700.0  # logarithm of the least probability that is told from 0


class Nis(NamedTuple):
    """Mean squared normal score of some rows, 1 under the right noise, with its two-sided 95 % band."""

    mean: float
    low: float
    high: float
    rows: int


class Diagnosis(NamedTuple):
    """Normal scores of a log, and what they say."""

    scores: dict[str, Float]  # by channel (n,), in the order of the recording
    nis: dict[str, Nis]  # by channel
    nis_by_landmark: dict[str, dict[int, Nis]]  # by channel, then id
    correlation: dict[str, Float]  # by channel (LAGS,): of a landmark's scores 1, 2, ... sights apart
    correlation_band: dict[str, float]  # by channel: 95 % of white scores' first are within


def diagnose(model: NoiseModel, innovations: Innovations, values: dict[str, float]) -> Diagnosis:
    """Normal scores of `innovations`; `values` are those that they were made with."""
    ids = model.recording.landmark
    assert ids is not None  # a noise model has them
    laws = {law.channel: law for law in model.laws if law.parameters[0] in values}
    scores: dict[str, Float] = {}
    by_landmark: dict[str, dict[int, Nis]] = {}
    correlation: dict[str, Float] = {}
    band: dict[str, float] = {}
    for channel in model.channels:
        rows = model.rows(channel)
        both = normal_scores(innovations.value[:, rows], innovations.variance[:, rows], laws.get(channel), values)
        tells = ~np.isnan(both[:, 0])
        found, seen = both[tells], ids[tells]
        scores[channel] = found.ravel()
        by_landmark[channel] = {int(each): nis_of(found[seen == each]) for each in np.unique(seen)}
        correlation[channel], pairs = autocorrelation(found, seen)
        band[channel] = 1.96 / max(pairs, 1) ** 0.5
    return Diagnosis(scores, {name: nis_of(each) for name, each in scores.items()}, by_landmark, correlation, band)


def nis_of(scores: Float) -> Nis:
    """The NIS of normal scores of any shape; NaN of none."""
    if not scores.size:
        return Nis(np.nan, np.nan, np.nan, 0)
    low, high = chi2_band(LEVEL, scores.size)
    return Nis(float(np.mean(scores**2)), low / scores.size, high / scores.size, scores.size)


def normal_scores(errors: Float, variances: Float, law: Law | None, values: dict[str, float]) -> Float:
    """Scores of innovations of any shape: the standard normal deviates of the same probability."""
    z = errors / np.sqrt(variances)
    if law is None:
        return z
    size = np.abs(z)
    if law.kind == "student-t":
        with np.errstate(divide="ignore"):
            tail = np.log(stdtr(values[f"{law.channel} dof"], -size))
    else:
        rate, spread = values[f"{law.channel} rate"], values[f"{law.channel} spread"]
        wide = np.abs(errors) / np.sqrt(variances + spread**2)
        with np.errstate(invalid="ignore"):  # rows that tell nothing have no score
            tail = np.logaddexp(np.log1p(-rate) + log_ndtr(-size), np.log(rate) + log_ndtr(-wide))
    return -np.sign(z) * ndtri_exp(np.maximum(tail, BEYOND))


def normal_quantiles(count: int) -> Float:
    """Quantiles (QUANTILES,) of the normal distribution, out to where the outermost of so many scores is expected."""
    reach = -ndtri(0.5 / count)
    return np.linspace(-reach, reach, QUANTILES)


def quantiles(scores: Float, expected: Float) -> Float:
    """The quantiles of scores (n,) that stand where `expected` ones of the normal distribution do."""
    return np.quantile(scores, ndtr(expected), method="hazen")


def autocorrelation(scores: Float, ids: Int) -> tuple[Float, int]:
    """Correlation (LAGS,) of scores (n, d) of a landmark 1, 2, ... sights apart, and how many pairs lag 1 has.

    Divided by the mean square, about 0 and not about each landmark's mean: an offset is no white noise.
    """
    order = np.argsort(ids, kind="stable")
    scores, ids = scores[order], ids[order]
    power = max(float(np.mean(scores**2)), 1e-300) if len(scores) else 1.0
    found, first_pairs = np.zeros(LAGS), 0
    for lag in range(1, LAGS + 1):
        same = ids[lag:] == ids[:-lag]
        products = (scores[lag:] * scores[:-lag])[same]
        found[lag - 1] = products.mean() / power if products.size else 0.0
        first_pairs = products.size if lag == 1 else first_pairs
    return found, first_pairs
