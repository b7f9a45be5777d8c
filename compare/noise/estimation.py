"""Estimation of the noise of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slamgauge.compare.noise.association import with_ids
from slamgauge.compare.noise.autocorrelation import (
    largest_correlation,
    observations_per_independent_one,
    with_larger_sigmas,
)
from slamgauge.compare.noise.diagnosis import Diagnosis, diagnose
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.compare.noise.likelihood import Interval, intervals
from slamgauge.compare.noise.outliers import fit
from slamgauge.compare.noise.parameters import SYSTEMATIC, Heading, NoiseParameters
from slamgauge.ekf.innovations import Innovations
from slamgauge.errors import UserError
from slamgauge.recording import Recording


class HeldOut(NamedTuple):
    """Log-likelihood of the noise found in the first half, minus that of the assumed noise, on the second half."""

    log_likelihood_gain: float  # [nats]
    observations: int  # number of observations in the second half


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a recording, as found by `find_noise`.

    Attributes:
        recording: measurements from which the noise was estimated: with ids, without contradicted first observations.
        assumed: sigmas of the recording by name.
        parameters: estimated sigmas by name: forward, lateral [m per step], turn [rad per step], range [m], bearing
            [rad] or position [m]; root mean squares over steps and observations.
        systematic: systematic errors by name, if requested.
        heading: forward direction to which headings refer.
        values: all estimated parameters by name, including those of outliers.
        rates: share of outliers of each channel with a mixture distribution.
        first_sights_left_out: number of excluded first observations, which the next ones contradict.
        left_without_id: number of excluded observations of a recording without ids, which fit no landmark.
        before: tests of the assumed noise.
        after: tests of the estimated noise.
        log_likelihood_gain: log-likelihood of the estimated noise minus that of the assumed noise [nats].
        held_out: the same on data that was not fitted; None if one half of the log does not determine the noise.
        sights_counted_as_one: number of observations of a landmark that count as one; 1 if errors are not correlated.
        tuned: the given recording with the estimated noise, covariances of observations times
            `sights_counted_as_one`, and without systematic errors; unchanged if `keeps_assumed`.
    """

    recording: Recording
    assumed: Mapping[str, float]
    parameters: Mapping[str, Interval]
    systematic: Mapping[str, Interval]
    heading: Heading
    values: Mapping[str, float]
    rates: Mapping[str, Interval]
    first_sights_left_out: int
    left_without_id: int
    before: Diagnosis
    after: Diagnosis
    log_likelihood_gain: float
    held_out: HeldOut | None
    sights_counted_as_one: float
    tuned: Recording

    @property
    def keeps_assumed(self) -> bool:
        """Whether `tuned` has the assumed noise, because this is more likely on the held-out half."""
        return _is_loss(self.held_out)

    @property
    def outlier_rate(self) -> float:
        """Share of observations with an outlier in one of their channels; 0 with Gaussian or Student's t errors."""
        return 1.0 - float(np.prod([1.0 - rate.value for rate in self.rates.values()]))


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
    tuned = NoiseParameters(recording).recording_with
    known = with_ids(recording)
    model = NoiseModel(known, systematic)
    _require_innovations(model.assumed_innovations())  # before the long computation
    found = fit(model)
    used, values = found.model, found.values
    before = _require_innovations(used.assumed_innovations())
    after = diagnose(used, found.innovations, values)
    held_out = _held_out(used, before)
    is_kept = _is_loss(held_out)
    correlation = 0.0 if is_kept else largest_correlation(after)
    counted = observations_per_independent_one(used, values, correlation) if correlation else 1.0
    rates = {each.channel: f"{each.channel} rate" for each in used.distributions if each.kind == "mixture"}
    errors = SYSTEMATIC if systematic else ()
    interval = intervals(found.likelihood, found.best, (*used.parameters.sigmas, *errors, *rates.values()))
    return Noise(
        recording=used.recording,
        assumed=model.parameters.assumed,
        parameters={name: interval[name] for name in used.parameters.sigmas},
        systematic={name: interval[name] for name in errors},
        values=values,
        heading=heading,
        rates={channel: interval[name] for channel, name in rates.items()},
        first_sights_left_out=len(known.observation) - len(used.recording.observation),
        left_without_id=len(recording.observation) - len(known.observation),
        before=diagnose(used, before, {}),
        after=after,
        log_likelihood_gain=float(found.innovations.log_likelihood.sum()) - float(before.log_likelihood.sum()),
        held_out=held_out,
        sights_counted_as_one=counted,
        tuned=recording if is_kept else tuned(with_larger_sigmas(used, values, counted), heading),
    )


def _require_innovations(found: Innovations | None) -> Innovations:
    if found is None:
        raise UserError("recording: the filter cannot compute an update with its covariances; give larger ones")
    if np.isnan(found.value).all():
        raise UserError("recording: no landmark is observed twice, so that no noise can be found; give a longer one")
    return found


def _is_loss(held_out: HeldOut | None) -> bool:
    return held_out is not None and held_out.log_likelihood_gain < 0.0


def _held_out(model: NoiseModel, before: Innovations) -> HeldOut | None:
    """Return the gain of the noise of the first half of the observations, with its own distributions, on the second."""
    recording = model.recording
    middle = int(recording.observation_step[len(recording.observation) // 2])
    second = recording.observation_step > middle
    first = recording.first(middle)
    if not (first.steps and second.any()):
        return None
    half = replace(model, recording=first, distributions=())
    assumed = half.assumed_innovations()
    if assumed is None or np.isnan(assumed.value).all():
        return None
    found = fit(half)
    after = replace(model, distributions=found.model.distributions).innovations(found.values)
    if after is None:
        return None
    return HeldOut(float((after.log_likelihood - before.log_likelihood)[second].sum()), int(second.sum()))
