"""A log's innovations as a function of parameters: its noise, its systematic errors, its outliers.

A parameter is the logarithm of a sigma over the one assumed, so that no bound is needed; a systematic error over its
unit; the logit of twice a rate, which is below a half, the logarithms of a spread and of degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import expit, logit

from slamgauge.arrays import Float
from slamgauge.compare.noise.parameters import SYSTEMATIC, Told
from slamgauge.ekf.innovations import MIXTURE, STUDENT_T, Innovations, Log, Tails, gaussian_tails
from slamgauge.recording import Recording

MOST = 0.5  # of the observations are outliers: most of them say where the others are
SYSTEMATIC_UNIT = 0.01  # of each: parameters of 1 are large, as for sigmas

Kind = Literal["mixture", "student-t"]


@dataclass(frozen=True)
class Law:
    """How a channel has outliers; without one it is Gaussian."""

    channel: str
    kind: Kind

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what has to be found beyond a sigma."""
        return tuple(f"{self.channel} {name}" for name in (("rate", "spread") if self.kind == "mixture" else ("dof",)))


class NoiseModel:
    """A recording with ids, as a function of parameters.

    Args:
        recording: `range-bearing` or `position`, with ids, steps and observations.
        systematic: whether systematic errors are looked for, too.
        laws: of the channels that have outliers.

    Attributes:
        told: what the parameters make of the recording.
        names: (P,) of the parameters: sigmas first, then systematic errors, then what `laws` need.

    Raises:
        UserError: a recording that cannot be used; see `Told` and `slamgauge.ekf.innovations.Log`.
    """

    def __init__(self, recording: Recording, *, systematic: bool = False, laws: tuple[Law, ...] = ()) -> None:
        self.recording, self.is_systematic, self.laws = recording, systematic, laws
        self.told = Told(recording)
        self.channels = self.told.channels
        tails = (name for law in laws for name in law.parameters)
        self.names = (*self.told.sigmas, *(SYSTEMATIC if systematic else ()), *tails)
        self._log = Log(recording)

    def with_laws(self, laws: tuple[Law, ...]) -> NoiseModel:
        """The same model with other laws."""
        return NoiseModel(self.recording, systematic=self.is_systematic, laws=laws)

    def on(self, recording: Recording) -> NoiseModel:
        """The same model of another recording."""
        return NoiseModel(recording, systematic=self.is_systematic, laws=self.laws)

    def start(self) -> Float:
        """(P,) what the recording assumes, no systematic errors; of a model without `laws`."""
        return np.zeros(len(self.names))

    def values(self, parameters: Float) -> dict[str, float]:
        """Sigmas, systematic errors, rates, spreads and degrees of freedom by name, in their units."""
        return {name: self.value(name, each) for name, each in zip(self.names, parameters.tolist(), strict=True)}

    def value(self, name: str, parameter: float) -> float:
        """What one parameter says, in its unit."""
        channel, _, of_law = name.partition(" ")
        if name in SYSTEMATIC:
            return SYSTEMATIC_UNIT * parameter
        if of_law == "rate":
            return MOST * float(expit(parameter))
        return float(np.exp(parameter)) * (1.0 if of_law == "dof" else self.told.begin[channel])

    def parameters(self, values: Mapping[str, float]) -> Float:
        """(P,) of these values; the other way about."""
        return np.array([self._parameter(name, values[name]) for name in self.names])

    def _parameter(self, name: str, value: float) -> float:
        channel, _, of_law = name.partition(" ")
        if name in SYSTEMATIC:
            return value / SYSTEMATIC_UNIT
        if of_law == "rate":
            return float(logit(value / MOST))
        return float(np.log(value / (1.0 if of_law == "dof" else self.told.begin[channel])))

    def innovations(self, parameters: Float) -> Innovations | None:
        """The filter's innovations under these parameters; None where no update exists."""
        return self.under(self.values(parameters))

    def under(self, values: Mapping[str, float]) -> Innovations | None:
        """The filter's innovations under these values."""
        return self._log.innovations(*self.told.measurements(values), self._tails(values))

    def as_assumed(self) -> Innovations | None:
        """The innovations under the noise that the recording assumes, as it stands."""
        own = self.recording
        measurements = (own.odometry, own.odometry_cov, own.observation, own.observation_cov)
        return self._log.innovations(*measurements, gaussian_tails())

    def rows(self, channel: str) -> list[int]:
        """Which of an observation's two rows a channel has."""
        return [0, 1] if len(self.channels) == 1 else [self.channels.index(channel)]

    def _tails(self, values: Mapping[str, float]) -> Tails:
        tails = gaussian_tails()
        for law in self.laws:
            rows = self.rows(law.channel)
            if law.kind == "mixture":
                tails.law[rows] = MIXTURE
                tails.rate[rows] = values[f"{law.channel} rate"]
                tails.spread[rows] = values[f"{law.channel} spread"]
            else:
                tails.law[rows] = STUDENT_T
                tails.dof[rows] = values[f"{law.channel} dof"]
        return tails
