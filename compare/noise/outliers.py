"""Which channels have outliers, and by which law: Gaussian, a mixture with a share of outliers, or Student's t.

Only channels whose innovations have heavy tails under the best Gaussian noise are looked at more closely; there the
laws compete by likelihood, each parameter charged log(n) / 2 (Schwarz, Annals of Statistics 6(2), 1978).

Tails without a gap are evidence only where errors are new with every sight: where they last, what looks like many small
outliers is a few large errors seen again and again. Only outliers that stand apart are looked for there.

A landmark that begins with an outlier stands in the wrong place, and all its later sights look like outliers. A first
sight that most of the next ones contradict is therefore left out, and the landmark begins with the next.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.noise.autocorrelation import lasting
from slamgauge.compare.noise.diagnosis import diagnose
from slamgauge.compare.noise.innovation_model import Law, NoiseModel
from slamgauge.compare.noise.likelihood import ITERATIONS, Likelihood
from slamgauge.ekf.innovations import Innovations

SIGNIFICANT = 5.0  # standard deviations of a kurtosis under the normal distribution
HEAVY = 1.0  # excess kurtosis that is worth another law: that of Student's t with 10 degrees of freedom
QUARTILE = 0.6744897501960817  # of the standard normal distribution
NEXT, FEWEST = 9, 3  # sights that judge a first one, at most and at least
FEW = 0.002  # outliers, with which a search begins at least
START_DOF = 4.0  # of Student's t
NEARLY = 8  # iterations that tell whether tails are heavy
REFINED = 4  # steps of a start
APART = 10.0  # sigmas of spread, from which on Student's t, which has no gap, is no rival


class Fit(NamedTuple):
    """A model at its maximum."""

    likelihood: Likelihood
    best: Float  # (P,)

    @property
    def model(self) -> NoiseModel:
        """The model."""
        return self.likelihood.model

    @property
    def values(self) -> dict[str, float]:
        """Its values at the maximum, by name."""
        return self.model.values(self.best)

    @property
    def innovations(self) -> Innovations:
        """The innovations there."""
        return _there(self.model, self.best)

    def finished(self) -> Fit:
        """The fit when no iterations are spared."""
        return Fit(self.likelihood, self.likelihood.maximum(self.best))

    @property
    def merit(self) -> float:
        """The log-likelihood there, less what its parameters cost."""
        rows = np.count_nonzero(~np.isnan(self.innovations.value))
        return self.likelihood.value(self.best) - 0.5 * len(self.best) * math.log(max(rows, 1))


def fit(model: NoiseModel) -> Fit:
    """The best noise, with outliers where the likelihood asks for them."""
    nearly = _maximum(model, model.start(), NEARLY)
    diagnosis = diagnose(nearly.model, nearly.innovations, nearly.values)
    heavy = [channel for channel, scores in diagnosis.scores.items() if _is_heavy(scores)]
    if not heavy:
        return nearly.finished()
    begun = _begun_mixture(nearly, heavy)
    if lasting(diagnosis) and not _is_apart(begun, heavy):
        return nearly.finished()
    mixed = _finished_mixture(begun)
    bare = model.on(mixed.model.recording)  # all laws compete on the same observations
    rivals = [mixed]
    if len(bare.recording.observation) == len(model.recording.observation):  # else there are outliers without doubt
        rivals.append(nearly)
    if not _is_apart(mixed, heavy):
        student = bare.with_laws(tuple(Law(channel, "student-t") for channel in heavy))
        rivals.append(_maximum(student, _start(student, nearly)))
    best = max(rivals, key=lambda each: each.merit)
    return best if best.model.laws else nearly.finished()


def _maximum(model: NoiseModel, start: Float, iterations: int = ITERATIONS) -> Fit:
    likelihood = Likelihood(model)
    return Fit(likelihood, likelihood.maximum(start, iterations))


def _is_heavy(scores: Float) -> bool:
    """Whether scores have more kurtosis than those of a normal distribution by chance."""
    if not len(scores):
        return False
    excess = float(np.mean(scores**4) / np.mean(scores**2) ** 2) - 3.0
    return excess > max(HEAVY, SIGNIFICANT * math.sqrt(24.0 / len(scores)))


def _begun_mixture(gaussian: Fit, heavy: list[str]) -> Fit:
    """A mixture near its maximum, with first sights left out that the next ones contradict."""
    model = gaussian.model.with_laws(tuple(Law(channel, "mixture") for channel in heavy))
    point = _start(model, gaussian)
    for _ in range(REFINED):
        model = _settled(model, point)
        point = _refined(model, point)
    return Fit(Likelihood(model), point)


def _finished_mixture(begun: Fit) -> Fit:
    """The best mixture."""
    mixed = begun.finished()
    again = _settled(mixed.model, mixed.best)
    return mixed if again is mixed.model else _maximum(again, mixed.best)


def _is_apart(mixed: Fit, heavy: list[str]) -> bool:
    """Whether a gap parts the outliers of every channel from its other errors."""
    return all(mixed.values[f"{channel} spread"] >= APART * mixed.values[channel] for channel in heavy)


def _start(model: NoiseModel, gaussian: Fit) -> Float:
    """Parameters (P,) from the scores under the best Gaussian noise: their median size and fourth moment.

    With a share f^2 of the variance left to those that are no outliers, E z^2 = f^2 + rate k^2 = 1 and
    E z^4 = 3 f^4 + 3 rate k^4.
    """
    values, scores = gaussian.values, diagnose(gaussian.model, gaussian.innovations, gaussian.values).scores
    for law in model.laws:
        z, sigma = scores[law.channel], values[law.channel]
        share = min(_robust_size(z) ** 2, 0.99)
        squared = max(float(np.mean(z**4)) / 3.0 - share**2, 1e-3) / (1.0 - share)
        values[law.channel] = sigma * math.sqrt(share)
        begin = (_bounded((1.0 - share) / squared), sigma * math.sqrt(squared))
        values |= dict(zip(law.parameters, begin if law.kind == "mixture" else (START_DOF,), strict=True))
    return model.parameters(values)


def _refined(model: NoiseModel, parameters: Float) -> Float:
    """Parameters nearer to the best ones of mixtures, by the weights that rows have under those given."""
    innovations = _there(model, parameters)
    values = model.values(parameters)
    for law in model.laws:
        rate, spread = law.parameters
        rows = model.rows(law.channel)
        tells = ~np.isnan(innovations.value[:, rows])
        e, v, w = (each[:, rows][tells] for each in innovations[:3])
        doubted = w < 0.5
        values[law.channel] *= _robust_size((e / np.sqrt(v))[~doubted])
        values[rate] = _bounded(float(doubted.mean()))
        if doubted.any():
            values[spread] = float(np.sqrt(np.mean(e[doubted] ** 2)))
    return model.parameters(values)


def _there(model: NoiseModel, parameters: Float) -> Innovations:
    found = model.innovations(parameters)
    assert found is not None, "the same noise had an update a moment ago"
    return found


def _robust_size(scores: Float) -> float:
    """Standard deviation of a normal distribution whose sizes have this median."""
    return float(np.median(np.abs(scores))) / QUARTILE


def _bounded(rate: float) -> float:
    return min(max(rate, FEW), 0.4)


def _settled(model: NoiseModel, parameters: Float) -> NoiseModel:
    """The model without first sights that most of the next ones contradict."""
    while True:
        gone = _contradicted(model, _there(model, parameters))
        if not len(gone):
            return model
        kept = np.ones(len(model.recording.observation), dtype=bool)
        kept[gone] = False
        model = model.on(model.recording.only(kept))


def _contradicted(model: NoiseModel, innovations: Innovations) -> list[int]:
    """First sights, by their place among the observations, after which most of the next look like outliers."""
    ids = model.recording.landmark
    assert ids is not None  # a noise model has them
    order = np.argsort(ids, kind="stable")
    doubted = innovations.weight.min(axis=1) < 0.5
    starts = np.flatnonzero(np.diff(ids[order], prepend=-1))
    found: list[int] = []
    for sights in np.split(order, starts[1:]):
        judges = doubted[sights[1 : 1 + NEXT]]
        if len(judges) >= FEWEST and judges.mean() > 0.5:
            found.append(int(sights[0]))
    return found
