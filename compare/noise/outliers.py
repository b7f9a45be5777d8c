"""Outliers: observations whose innovations are much larger than those of most others, and the noise without them.

An innovation is an outlier if it is more than LARGE robust sigmas of its channel away from 0; with Gaussian errors that
happens to one in a million. Outliers are excluded and the noise is fitted again, until none is found.

An outlier moves its landmark, so that the next observations look like outliers, too. Therefore the earliest of each
landmark is excluded before the others are judged again. A landmark that starts with an outlier is at a wrong position:
if several of its next observations look like outliers, the first one is excluded if fewer do so then.
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
PASSES = 100  # largest number of outliers of a landmark in a fit
QUARTILE = 0.6744897501960817  # upper quartile of the standard normal distribution
NEXT, FEWEST = 9, 2  # a first observation is judged if FEWEST of the NEXT ones look like outliers


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
        own, sigmas = found.model.recording, _outlying(found)
        assert own.landmark is not None  # a noise model has ids
        if not sigmas:
            break
        excluded = np.isin(np.arange(len(rows)), [*sigmas])
        for row, each in sigmas.items():
            outliers.append(Outlier(int(rows[row]), int(own.observation_step[row]), int(own.landmark[row]), each))
        rows = rows[~excluded]
        found = Fit(replace(model, recording=own.only(~excluded)))
    return found, sorted(outliers)


def _outlying(found: Fit) -> dict[int, float]:
    """Return the rows of the outliers, and their scores."""
    ids, outliers = found.model.recording.landmark, dict[int, float]()
    assert ids is not None
    kept = np.ones(len(ids), dtype=np.bool_)
    for _ in range(PASSES):
        scores = _robust_scores(found, kept)
        for each in np.unique(ids[scores > LARGE]):
            mine = np.flatnonzero((ids == each) & kept)
            chosen, first = mine[scores[mine] > LARGE][0], mine[0]
            if np.sum(scores[mine[1 : 1 + NEXT]] > LARGE) >= FEWEST:
                left = {row: np.sum(_robust_scores(found, kept, row)[mine] > LARGE) for row in (chosen, first)}
                chosen = min(left, key=left.__getitem__)
            outliers[int(chosen)] = float(scores[chosen])
        if not kept[[*outliers]].any():
            break
        kept[[*outliers]] = False
    return outliers


def _robust_scores(found: Fit, kept: Marks, without: int | None = None) -> Float:
    """Return the largest absolute score (M,) of each observation that is kept, in robust sigmas; else NaN."""
    kept = kept.copy()
    if without is not None:
        kept[without] = False
    model = replace(found.model, recording=found.model.recording.only(kept))
    innovations = model.innovations(found.values)
    assert innovations is not None, "the filter computed an update with this noise before"
    scores = np.abs(diagnose(model, innovations).scores)
    robust = np.ones(scores.shape[1])
    for channel in model.parameters.channels:
        rows = model.parameters.rows(channel)
        robust[rows] = np.nanmedian(scores[:, rows]) / QUARTILE
    every = np.full(len(kept), np.nan)
    every[kept] = np.fmax.reduce(scores / robust, axis=1)
    return every
