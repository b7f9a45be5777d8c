"""The noise that the measurements of a recording support."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamgauge.compare.noise.association import with_ids
from slamgauge.compare.noise.autocorrelation import larger, lasting, sights_counted_as_one
from slamgauge.compare.noise.diagnosis import Diagnosis, diagnose
from slamgauge.compare.noise.innovation_model import NoiseModel
from slamgauge.compare.noise.outliers import Fit, fit
from slamgauge.compare.noise.parameters import SYSTEMATIC, Heading, Told
from slamgauge.compare.noise.profile_likelihood import ends
from slamgauge.ekf.innovations import Innovations
from slamgauge.errors import UserError
from slamgauge.recording import Recording


class Supported(NamedTuple):
    """A value with its 95 % profile likelihood interval; an end that the log does not have is infinite.

    The low end of a sigma is 0 where any smaller value will do.
    """

    value: float
    low: float
    high: float


class HeldOut(NamedTuple):
    """How much likelier the second half of the observations is under the noise found in the first than as assumed."""

    log_likelihood_gain: float  # [nats]
    observations: int  # of the second half


@dataclass(frozen=True, eq=False)
class Noise:
    """What `find_noise` has found.

    Attributes:
        recording: what the noise was found in: with ids, without first sights that later ones contradict.
        assumed: the recording's own sigmas by name.
        parameters: sigmas by name: forward, lateral [m per step], turn [rad per step], range [m], bearing [rad] or
            position [m]; root mean squares over steps and observations.
        systematic: systematic errors by name, if they were asked for.
        heading: whose straight ahead the headings of what is told are.
        values: of all that was fitted, by name: what tells of outliers among it.
        rates: share of outliers by channel that has a mixture.
        first_sights_left_out: how many the next ones contradict.
        left_without_id: observations of a recording without ids that found no landmark.
        before: what the innovations say of the noise assumed.
        after: the same of the noise found.
        log_likelihood_gain: of the noise found over the one assumed [nats].
        held_out: the gain where nothing was fitted; None if one half of the log tells too little.
        sights_counted_as_one: how many of a landmark, because their errors last; 1 where they are white.
        told: the recording given, with the noise found, covariances of observations times `sights_counted_as_one`, and
            without the systematic errors; as it was given where what is found loses on what was held out.
    """

    recording: Recording
    assumed: Mapping[str, float]
    parameters: Mapping[str, Supported]
    systematic: Mapping[str, Supported]
    heading: Heading
    values: Mapping[str, float]
    rates: Mapping[str, Supported]
    first_sights_left_out: int
    left_without_id: int
    before: Diagnosis
    after: Diagnosis
    log_likelihood_gain: float
    held_out: HeldOut | None
    sights_counted_as_one: float
    told: Recording

    @property
    def keeps_assumed(self) -> bool:
        """Whether what is told is what was assumed, since that is likelier where nothing was fitted."""
        return _loses(self.held_out)

    @property
    def outlier_rate(self) -> float:
        """Share of observations with an outlier in one of their channels; 0 with Gaussian or Student's t tails."""
        return 1.0 - float(np.prod([1.0 - rate.value for rate in self.rates.values()]))


def find_noise(recording: Recording, *, systematic: bool = False, heading: Heading = "sensor") -> Noise:
    """The noise that the measurements of a recording support: maximum likelihood of the filter's innovations.

    Args:
        recording: `range-bearing` or `position`; without ids, landmarks are associated jointly (`jcbb`).
        systematic: whether to look for systematic errors, too: odometry scale, turn per metre, offsets of the sensor.
        heading: whose straight ahead the heading of the start is, which the log cannot tell: where bearings have an
            offset, the other's measurements are turned by it.

    Raises:
        UserError: the recording has bearings alone, no steps or no observations, or no landmark is seen twice.
    """
    known = with_ids(recording)
    model = NoiseModel(known, systematic=systematic)
    _require_update(model.as_assumed())  # before long work
    found = fit(model)
    used = found.model
    before = _require_update(used.as_assumed())
    values, local = found.values, _supported(found)
    after = diagnose(used, found.innovations, values)
    held_out = _held_out(used, before)
    is_kept = _loses(held_out)
    correlation = 0.0 if is_kept else lasting(after)
    counted = sights_counted_as_one(used, values, correlation) if correlation else 1.0
    return Noise(
        recording=used.recording,
        assumed=model.told.assumed,
        parameters={name: local(name) for name in model.told.sigmas},
        systematic={name: local(name) for name in SYSTEMATIC if systematic},
        values=values,
        heading=heading,
        rates={law.channel: local(f"{law.channel} rate") for law in used.laws if law.kind == "mixture"},
        first_sights_left_out=len(known.observation) - len(used.recording.observation),
        left_without_id=len(recording.observation) - len(known.observation),
        before=diagnose(used, before, {}),
        after=after,
        log_likelihood_gain=_total(found.innovations) - _total(before),
        held_out=held_out,
        sights_counted_as_one=counted,
        told=recording if is_kept else Told(recording).under(larger(used, values, counted), heading),
    )


def _require_update(found: Innovations | None) -> Innovations:
    """The innovations of the noise that is assumed.

    Raises:
        UserError: there are none.
    """
    if found is None:
        raise UserError("recording: the filter has no update under the noise that it states; scale its covariances up")
    if np.isnan(found.value).all():
        raise UserError("recording: no landmark is seen twice, which tells no noise; give a longer one")
    return found


def _supported(found: Fit) -> Callable[[str], Supported]:
    """What is found of a parameter by its name."""

    def local(name: str) -> Supported:
        place = found.model.names.index(name)
        low, high = ends(found.likelihood, found.best, place)
        value = found.model.value
        return Supported(value(name, float(found.best[place])), value(name, low), value(name, high))

    return local


def _total(innovations: Innovations) -> float:
    return float(innovations.log_likelihood.sum())


def _loses(held_out: HeldOut | None) -> bool:
    return held_out is not None and held_out.log_likelihood_gain < 0.0


def _held_out(model: NoiseModel, before: Innovations) -> HeldOut | None:
    """The noise of the first half of the observations, with its own laws, scored on the second."""
    recording = model.recording
    middle = int(recording.observation_step[len(recording.observation) // 2])
    second = recording.observation_step > middle
    first = recording.first(middle)
    if not (first.steps and second.any()):
        return None
    half = model.with_laws(()).on(first)
    assumed = half.as_assumed()
    if assumed is None or np.isnan(assumed.value).all():
        return None
    found = fit(half)
    after = model.with_laws(found.model.laws).under(found.values)
    if after is None:
        return None
    gain = float((after.log_likelihood - before.log_likelihood)[second].sum())
    return HeldOut(gain, int(second.sum()))
