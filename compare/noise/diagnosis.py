"""Tests of assumed noise by the innovations of a log.

A score is an innovation over its standard deviation. If the noise is right, scores are independent and standard normal.
Then the mean of their squares, the NIS per row, is 1, and successive scores of a landmark are not correlated.

A channel is a sensor component with its own noise: range, bearing, or both coordinates of a position.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.noise.likelihood import NoiseModel
from slamgauge.compare.scoring.consistency import chi2_band
from slamgauge.compare.scoring.intervals import LEVEL
from slamgauge.ekf.innovations import Innovations


class Nis(NamedTuple):
    """Mean of the squares of `rows` scores, expected to be 1 if the noise is right, and its 95 % band."""

    mean: float | None
    low: float | None
    high: float | None
    rows: int


class Correlation(NamedTuple):
    """Correlation of successive scores of a landmark, and its 95 % limit for white noise."""

    value: float
    band: float


@dataclass(frozen=True)
class Diagnosis:
    """Scores (M, 2) of a log, NaN without information, and their statistics by channel."""

    scores: Float
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


def autocorrelation(scores: Float, ids: Int) -> Correlation:
    """Return the correlation of successive scores (n, d) of the same landmark, with ids (n,), in the recording's order.

    The mean product of the pairs is divided by the mean square of all scores. No mean is subtracted, because an offset
    is not white noise.
    """
    order = np.argsort(ids, kind="stable")
    scores, ids = scores[order], ids[order]
    products = (scores[1:] * scores[:-1])[ids[1:] == ids[:-1]]
    power = float(np.mean(scores**2)) if products.size else 1.0
    return Correlation(float(products.sum()) / max(products.size, 1) / power, 1.96 / max(products.size, 1) ** 0.5)
