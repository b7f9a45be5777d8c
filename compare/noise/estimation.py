"""Estimation of the noise of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slamgauge.compare.noise.diagnosis import Diagnosis, diagnose
from slamgauge.compare.noise.likelihood import Fit, NoiseModel
from slamgauge.compare.noise.outliers import Outlier, fit_without_outliers
from slamgauge.compare.noise.parameters import SYSTEMATIC, Heading, NoiseParameters
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.ekf.estimators import riekf
from slamgauge.ekf.innovations import Innovations
from slamgauge.ekf.settings import Association, FilterSettings, MapManagement
from slamgauge.errors import UserError
from slamgauge.recording import Recording

# A smaller gate would make the noise look too small; this one excludes 3 in 10 000 correct observations.
JOINT = FilterSettings(Association(method="jcbb", gate=16.0, map_management=MapManagement()))


class HeldOut(NamedTuple):
    """Log-likelihood of the noise found in the first half, minus that of the assumed noise, on the second half."""

    log_likelihood_gain: float  # [nats]
    observations: int  # number of observations in the second half


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a recording, as found by `find_noise`.

    Attributes:
        recording: measurements from which the noise was estimated: with ids, without outliers.
        assumed: sigmas of the recording by name.
        parameters: estimated sigmas by name: forward, lateral [m per step], turn [rad per step], range [m], bearing
            [rad] or position [m]; root mean squares over steps and observations.
        systematic: systematic errors by name, if requested.
        heading: forward direction to which headings refer.
        outliers: excluded observations.
        left_without_id: number of excluded observations of a recording without ids, which fit no landmark.
        before: tests of the assumed noise.
        after: tests of the estimated noise.
        log_likelihood_gain: log-likelihood of the estimated noise minus that of the assumed noise [nats].
        held_out: the same on data that was not fitted; None if one half of the log does not determine the noise.
        keeps_assumed: whether `tuned` has the assumed noise, because this is more likely on the held-out half.
        tuned: the given recording with the estimated noise and without systematic errors; unchanged if `keeps_assumed`.
    """

    recording: Recording
    assumed: Mapping[str, float]
    parameters: Mapping[str, Interval]
    systematic: Mapping[str, Interval]
    heading: Heading
    outliers: list[Outlier]
    left_without_id: int
    before: Diagnosis
    after: Diagnosis
    log_likelihood_gain: float
    held_out: HeldOut | None
    keeps_assumed: bool
    tuned: Recording

    @property
    def outlier_rate(self) -> float:
        """Share of the observations that are outliers."""
        return len(self.outliers) / (len(self.outliers) + len(self.recording.observation))


def find_noise(recording: Recording, *, systematic: bool = False, heading: Heading = "sensor") -> Noise:
    """Return the maximum likelihood estimate of the noise of a recording, by the innovations of `riekf`.

    Args:
        recording: `range-bearing` or `position`; without ids, landmarks are associated jointly (`jcbb`).
        systematic: estimate systematic errors, too: odometry scale, turn per metre, offsets of the sensor.
        heading: forward direction to which the heading of the start refers, the sensor's or the odometry's. The log
            does not determine it. With a bearing offset, the measurements of the other one are rotated by the offset.

    Raises:
        UserError: the recording is bearing-only, has no steps or no observations, or no landmark is re-observed.
    """
    given = NoiseParameters(recording)
    known = _with_ids(recording)
    _require_innovations(NoiseModel(known).assumed_innovations())  # before the long computation
    found, outliers = fit_without_outliers(NoiseModel(known, systematic))
    before, after = _require_innovations(found.model.assumed_innovations()), found.innovations()
    held_out = _held_out(found.model, before)
    is_loss = held_out is not None and held_out.log_likelihood_gain < 0.0
    return Noise(
        recording=found.model.recording,
        assumed=given.assumed,
        parameters={name: found.interval(name) for name in given.sigmas},
        systematic={name: found.interval(name) for name in (SYSTEMATIC if systematic else ())},
        heading=heading,
        outliers=outliers,
        left_without_id=len(recording.observation) - len(known.observation),
        before=diagnose(found.model, before),
        after=diagnose(found.model, after),
        log_likelihood_gain=float(after.log_likelihood.sum()) - float(before.log_likelihood.sum()),
        held_out=held_out,
        keeps_assumed=is_loss,
        tuned=recording if is_loss else given.recording_with(found.values, heading),
    )


def _with_ids(recording: Recording) -> Recording:
    """Return the recording with ids: its own, or those of `riekf` with joint compatibility (JCBB).

    Observations without a landmark are excluded.
    """
    if recording.landmark is not None:
        return recording
    ids = riekf(recording, JOINT).association
    if ids is None or not (ids >= 0).any():
        raise UserError("recording: it has no ids, and no observation fits a landmark; give larger covariances")
    return recording.associated(ids)


def _require_innovations(found: Innovations | None) -> Innovations:
    if found is None:
        raise UserError("recording: the filter cannot compute an update with its covariances; give larger ones")
    if np.isnan(found.value).all():
        raise UserError("recording: no landmark is observed twice, so that no noise can be found; give a longer one")
    return found


def _held_out(model: NoiseModel, before: Innovations) -> HeldOut | None:
    """Return the gain of the noise of the first half of the observations on the second half."""
    recording = model.recording
    middle = int(recording.observation_step[len(recording.observation) // 2])
    second = recording.observation_step > middle
    half = replace(model, recording=recording.first(middle))
    if not (half.recording.steps and second.any()):
        return None
    assumed = half.assumed_innovations()
    after = None if assumed is None or np.isnan(assumed.value).all() else model.innovations(Fit(half).values)
    if after is None:
        return None
    return HeldOut(float((after.log_likelihood - before.log_likelihood)[second].sum()), int(second.sum()))
