"""Outliers: observations whose innovations are much larger than those of most others, and the noise without them.

An innovation is an outlier if it is more than LARGE robust sigmas of its channel away from 0; with Gaussian errors that
happens to one in a million. Outliers are excluded and the noise is fitted again, until none is found.

A landmark that starts with an outlier is at a wrong position, so that its next observations look like outliers. If most
of them do, only the first one is excluded, and the landmark starts with the second one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.noise.diagnosis import diagnose
from slamgauge.compare.noise.likelihood import Fit, NoiseModel

LARGE = 5.0  # robust sigmas
ROUNDS = 6  # largest number of fits
QUARTILE = 0.6744897501960817  # upper quartile of the standard normal distribution
NEXT, FEWEST = 9, 3  # largest and smallest number of observations that judge a first one


class Outlier(NamedTuple):
    """An excluded observation: row of the recording, step, landmark, and normalised innovation; NaN for a first one."""

    observation: int
    step: int
    landmark: int
    sigmas: float


def fit_without_outliers(model: NoiseModel) -> tuple[Fit, list[Outlier]]:
    """Return the most likely noise without the outliers, and these in the order of the recording."""
    found, rows, outliers = Fit(model), np.arange(len(model.recording.observation)), list[Outlier]()
    for _ in range(ROUNDS):
        own = found.model.recording
        assert own.landmark is not None  # a noise model has ids
        sigmas = _robust_scores(found)
        excluded = _excluded(sigmas > LARGE, own.landmark)
        if not excluded.any():
            break
        columns = (rows, own.observation_step, own.landmark, sigmas)
        outliers += map(Outlier, *(column[excluded].tolist() for column in columns))
        rows = rows[~excluded]
        found = Fit(replace(model, recording=own.only(~excluded)))
    return found, sorted(outliers)


def _robust_scores(found: Fit) -> Float:
    """Return the largest absolute score (M,) of each observation, in robust sigmas; NaN without a score."""
    scores = np.abs(diagnose(found.model, found.innovations()).scores)
    robust = np.ones(scores.shape[1])
    for channel in found.model.parameters.channels:
        rows = found.model.parameters.rows(channel)
        robust[rows] = np.nanmedian(scores[:, rows]) / QUARTILE
    return np.fmax.reduce(scores / robust, axis=1)


def _excluded(outlying: Marks, ids: np.ndarray) -> Marks:
    """Return which observations (M,) are excluded: the outlying ones, or the first of a landmark instead."""
    excluded = outlying.copy()
    for each in np.unique(ids[outlying]):
        rows = np.flatnonzero(ids == each)
        judges = outlying[rows[1 : 1 + NEXT]]
        if len(judges) >= FEWEST and judges.mean() > 0.5:
            excluded[rows] = False
            excluded[rows[0]] = True
    return excluded
