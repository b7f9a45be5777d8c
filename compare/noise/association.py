"""Ids for a recording without: the filter's own, associated jointly under noise that is found meanwhile."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.compare.noise.outliers import fit
from slamgauge.compare.noise.parameters import Told
from slamgauge.ekf.estimators import riekf
from slamgauge.ekf.settings import Association, FilterSettings, MapManagement
from slamgauge.errors import UserError
from slamgauge.recording import Recording

# a wide gate: what is left out beyond it, 3 in 10 000, would make noise look smaller than it is
JOINT = FilterSettings(Association(method="jcbb", gate=16.0, map_management=MapManagement()))
ROUNDS = 4  # of association and fit at most
SETTLED = 0.002  # share of the observations that a round may associate otherwise


def with_ids(recording: Recording) -> Recording:
    """The recording itself if it has ids; else with the tracks of a right-invariant filter that associates jointly.

    Which observations are a landmark's depends on the noise, and the noise on them: both are found in turn. What finds
    no landmark is left out.

    Raises:
        UserError: nothing is associated.
    """
    if recording.landmark is not None:
        return recording
    told = Told(recording)
    given = _associate(recording)
    for _ in range(ROUNDS):
        found = fit(NoiseModel(recording.associated(given)))
        previous, given = given, _associate(told.under(found.values))
        if np.mean(_partition(given) != _partition(previous)) <= SETTLED:
            break
    return recording.associated(given)


def _associate(recording: Recording) -> Int:
    """The track (M,) of every observation, -1 of what has none."""
    given = riekf(recording, JOINT).association
    if given is None or not (given >= 0).any():
        raise UserError("recording: it has no ids, and no observation finds a landmark; state larger covariances")
    return given


def _partition(given: Int) -> Int:
    """The first observation of the same track, for every observation (M,); -1 of what has none."""
    _, first, track = np.unique(given, return_index=True, return_inverse=True)
    return np.where(given < 0, -1, first[track])
