"""Association of a recording without ids, jointly with its noise."""

from __future__ import annotations

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.compare.noise.outliers import fit
from slamgauge.compare.noise.parameters import NoiseParameters
from slamgauge.ekf.estimators import riekf
from slamgauge.ekf.settings import Association, FilterSettings, MapManagement
from slamgauge.errors import UserError
from slamgauge.recording import Recording

# A smaller gate would make the noise look too small; this one excludes 3 in 10 000 correct observations.
JOINT = FilterSettings(Association(method="jcbb", gate=16.0, map_management=MapManagement()))
ROUNDS = 4  # largest number of rounds of association and fit
SETTLED = 0.002  # share of observations whose association may change in the last round


def with_ids(recording: Recording) -> Recording:
    """Return the recording with ids: its own, or else those of `riekf` with joint compatibility (JCBB).

    The association depends on the noise and the noise on the association, so both are estimated in turn. Observations
    without a landmark are excluded.

    Raises:
        UserError: no observation can be associated.
    """
    if recording.landmark is not None:
        return recording
    ids = _associate(recording)
    for _ in range(ROUNDS):
        found = fit(NoiseModel(recording.associated(ids)))
        previous, ids = ids, _associate(NoiseParameters(recording).recording_with(found.values))
        if np.mean(_first_of_track(ids) != _first_of_track(previous)) <= SETTLED:
            break
    return recording.associated(ids)


def _associate(recording: Recording) -> Int:
    """Return the landmark (M,) of each observation, or -1."""
    ids = riekf(recording, JOINT).association
    if ids is None or not (ids >= 0).any():
        raise UserError("recording: it has no ids, and no observation fits a landmark; give larger covariances")
    return ids


def _first_of_track(ids: Int) -> Int:
    """Return for each observation (M,) the first observation of the same landmark, or -1."""
    _, first, track = np.unique(ids, return_index=True, return_inverse=True)
    return np.where(ids < 0, -1, first[track])
