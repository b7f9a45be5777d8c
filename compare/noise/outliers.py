"""Choice of the error distribution of each channel: Gaussian, a mixture with outliers, or Student's t.

Other distributions than the Gaussian are tried for channels whose innovations have heavy tails under the best Gaussian
noise. The one with the highest likelihood is chosen, less log(n) / 2 for each parameter (Schwarz, Annals of Statistics
6(2), 1978).

If errors of successive observations are correlated, a few large errors, observed repeatedly, look like many small
outliers. Then only outliers that are clearly separated from other errors count as evidence.

A landmark that starts with an outlier is at a wrong position, so that all its later observations look like outliers. If
most of the next observations contradict the first one, it is excluded, and the landmark starts with the second one.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.noise.autocorrelation import largest_correlation
from slamgauge.compare.noise.diagnosis import diagnose
from slamgauge.compare.noise.innovation_model import ErrorDistribution, Kind, NoiseModel
from slamgauge.compare.noise.likelihood import ITERATIONS, Likelihood
from slamgauge.ekf.innovations import Innovations

SIGNIFICANT = 5.0  # standard deviations of the kurtosis of normal scores
HEAVY = 1.0  # smallest excess kurtosis of heavy tails: that of Student's t with 10 degrees of freedom
QUARTILE = 0.6744897501960817  # upper quartile of the standard normal distribution
NEXT, FEWEST = 9, 3  # largest and smallest number of observations that judge a first one
SMALLEST_RATE = 0.002  # rate of outliers at the start of a search
START_DOF = 4.0  # degrees of freedom of Student's t at the start of a search
GAUSSIAN_ITERATIONS = 8  # iterations of the Gaussian fit that decides whether tails are heavy
REFINEMENTS = 4  # number of refinements of the start of a mixture
SEPARATED = 10.0  # ratio of spread and sigma above which Student's t, which has no gap, is not tried


class Fit(NamedTuple):
    """A likelihood and its maximum."""

    likelihood: Likelihood
    best: Float  # (P,)

    @property
    def model(self) -> NoiseModel:
        """The noise model."""
        return self.likelihood.model

    @property
    def values(self) -> dict[str, float]:
        """Values at the maximum, by name."""
        return self.model.values(self.best)

    @property
    def innovations(self) -> Innovations:
        """Innovations at the maximum."""
        return _innovations(self.model, self.best)

    def finished(self) -> Fit:
        """Return the fit after all further iterations."""
        return Fit(self.likelihood, self.likelihood.maximum(self.best))

    @property
    def merit(self) -> float:
        """Log-likelihood at the maximum, minus a cost for each parameter."""
        rows = np.count_nonzero(~np.isnan(self.innovations.value))
        return self.likelihood.value(self.best) - 0.5 * len(self.best) * math.log(max(rows, 1))


def fit(model: NoiseModel) -> Fit:
    """Return the most likely noise, with outliers if they increase the likelihood enough."""
    gaussian = _maximum(model, np.zeros(len(model.names)), GAUSSIAN_ITERATIONS)
    diagnosis = diagnose(gaussian.model, gaussian.innovations, gaussian.values)
    heavy = [channel for channel, scores in diagnosis.scores.items() if _has_heavy_tails(scores)]
    if not heavy:
        return gaussian.finished()
    mixture = _begun_mixture(gaussian, heavy)
    if largest_correlation(diagnosis) and not _are_separated(mixture, heavy):
        return gaussian.finished()
    mixture = mixture.finished()
    again = _without_contradicted(mixture.model, mixture.best)
    if again is not mixture.model:
        mixture = _maximum(again, mixture.best)
    used = mixture.model.recording  # all candidates are fitted to the same observations
    candidates = [mixture]
    if len(used.observation) == len(model.recording.observation):  # otherwise outliers certainly exist
        candidates.append(gaussian)
    if not _are_separated(mixture, heavy):
        student = replace(model, recording=used, distributions=_distributions(heavy, "student-t"))
        candidates.append(_maximum(student, _start(student, gaussian)))
    best = max(candidates, key=lambda each: each.merit)
    return best if best.model.distributions else gaussian.finished()


def _distributions(channels: list[str], kind: Kind) -> tuple[ErrorDistribution, ...]:
    return tuple(ErrorDistribution(channel, kind) for channel in channels)


def _maximum(model: NoiseModel, start: Float, iterations: int = ITERATIONS) -> Fit:
    likelihood = Likelihood(model)
    return Fit(likelihood, likelihood.maximum(start, iterations))


def _has_heavy_tails(scores: Float) -> bool:
    """Return whether the kurtosis of scores is significantly larger than that of a normal distribution."""
    if not len(scores):
        return False
    excess = float(np.mean(scores**4) / np.mean(scores**2) ** 2) - 3.0
    return excess > max(HEAVY, SIGNIFICANT * math.sqrt(24.0 / len(scores)))


def _begun_mixture(gaussian: Fit, heavy: list[str]) -> Fit:
    """Return a mixture near its maximum, without contradicted first observations."""
    model = replace(gaussian.model, distributions=_distributions(heavy, "mixture"))
    point = _start(model, gaussian)
    for _ in range(REFINEMENTS):
        model = _without_contradicted(model, point)
        point = _refined(model, point)
    return Fit(Likelihood(model), point)


def _are_separated(mixture: Fit, heavy: list[str]) -> bool:
    """Return whether outliers are much larger than other errors in every channel."""
    return all(mixture.values[f"{channel} spread"] >= SEPARATED * mixture.values[channel] for channel in heavy)


def _start(model: NoiseModel, gaussian: Fit) -> Float:
    """Return a start (P,) from median size and fourth moment of the scores z under the best Gaussian noise.

    With the share f^2 of the variance for errors that are not outliers, E z^2 = f^2 + rate k^2 = 1 and
    E z^4 = 3 f^4 + 3 rate k^4.
    """
    values, scores = gaussian.values, diagnose(gaussian.model, gaussian.innovations, gaussian.values).scores
    for each in model.distributions:
        z, sigma = scores[each.channel], values[each.channel]
        share = min(_robust_sigma(z) ** 2, 0.99)
        squared = max(float(np.mean(z**4)) / 3.0 - share**2, 1e-3) / (1.0 - share)
        values[each.channel] = sigma * math.sqrt(share)
        begin = (_bounded((1.0 - share) / squared), sigma * math.sqrt(squared))
        values |= dict(zip(each.parameters, begin if each.kind == "mixture" else (START_DOF,), strict=True))
    return model.point(values)


def _refined(model: NoiseModel, point: Float) -> Float:
    """Return a better start (P,) of mixtures, from the weights of rows at `point`."""
    innovations, values = _innovations(model, point), model.values(point)
    for each in model.distributions:
        rate, spread = each.parameters
        rows = model.rows(each.channel)
        defined = ~np.isnan(innovations.value[:, rows])
        e, v, w = (column[:, rows][defined] for column in innovations[:3])
        outlying = w < 0.5
        values[each.channel] *= _robust_sigma((e / np.sqrt(v))[~outlying])
        values[rate] = _bounded(float(outlying.mean()))
        if outlying.any():
            values[spread] = float(np.sqrt(np.mean(e[outlying] ** 2)))
    return model.point(values)


def _innovations(model: NoiseModel, point: Float) -> Innovations:
    found = model.innovations(model.values(point))
    assert found is not None, "the filter computed an update with this noise before"
    return found


def _robust_sigma(scores: Float) -> float:
    """Return the sigma of a normal distribution with the same median of absolute values."""
    return float(np.median(np.abs(scores))) / QUARTILE


def _bounded(rate: float) -> float:
    return min(max(rate, SMALLEST_RATE), 0.4)


def _without_contradicted(model: NoiseModel, point: Float) -> NoiseModel:
    """Return the model without first observations that most of the next ones contradict."""
    while contradicted := _contradicted(model, _innovations(model, point)):
        kept = np.ones(len(model.recording.observation), dtype=bool)
        kept[contradicted] = False
        model = replace(model, recording=model.recording.only(kept))
    return model


def _contradicted(model: NoiseModel, innovations: Innovations) -> list[int]:
    """Return the rows of first observations for which most of the next ones look like outliers."""
    ids = model.recording.landmark
    assert ids is not None  # a noise model has ids
    order = np.argsort(ids, kind="stable")
    outlying = innovations.weight.min(axis=1) < 0.5
    starts = np.flatnonzero(np.diff(ids[order], prepend=-1))
    found: list[int] = []
    for rows in np.split(order, starts[1:]):
        judges = outlying[rows[1 : 1 + NEXT]]
        if len(judges) >= FEWEST and judges.mean() > 0.5:
            found.append(int(rows[0]))
    return found
