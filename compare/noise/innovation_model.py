"""Innovations of a log as a function of its noise, its systematic errors and its outliers.

An optimiser works with unbounded coordinates of the values: the logarithm of a sigma relative to the assumed one, a
systematic error divided by its unit, the logit of twice a rate (which is below a half), and the logarithms of a spread
and of degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.special import expit, logit

from slamgauge.arrays import Float
from slamgauge.compare.noise.parameters import SYSTEMATIC, NoiseParameters
from slamgauge.ekf.innovations import MIXTURE, STUDENT_T, Innovations, Log, Tails, gaussian_tails
from slamgauge.recording import Recording

LARGEST_RATE = 0.5  # largest share of outliers
SYSTEMATIC_UNIT = 0.01  # a coordinate of 1 is large, as for sigmas


Kind = Literal["mixture", "student-t"]


@dataclass(frozen=True)
class ErrorDistribution:
    """Distribution of the errors of a channel with outliers; other channels are Gaussian."""

    channel: str
    kind: Kind

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters in addition to a sigma."""
        return tuple(f"{self.channel} {name}" for name in (("rate", "spread") if self.kind == "mixture" else ("dof",)))


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """A recording as a function of its noise parameters.

    Attributes:
        recording: recording with ids; see `NoiseParameters` and `slamgauge.ekf.innovations.Log` for errors.
        systematic: whether the parameters include systematic errors.
        distributions: distributions of the channels with outliers.
    """

    recording: Recording
    systematic: bool = False
    distributions: tuple[ErrorDistribution, ...] = ()

    @cached_property
    def parameters(self) -> NoiseParameters:
        """Noise parameters of the recording."""
        return NoiseParameters(self.recording)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(P,) names of the values: sigmas, systematic errors, and parameters of `distributions`."""
        tails = (name for each in self.distributions for name in each.parameters)
        return (*self.parameters.sigmas, *(SYSTEMATIC if self.systematic else ()), *tails)

    @cached_property
    def _log(self) -> Log:
        return Log(self.recording)

    def values(self, point: Float) -> dict[str, float]:
        """Return all values by name, in their units, at coordinates (P,)."""
        return {name: self.value(name, each) for name, each in zip(self.names, point.tolist(), strict=True)}

    def value(self, name: str, coordinate: float) -> float:
        """Return the value of one coordinate, in its unit."""
        channel, _, tail = name.partition(" ")
        if name in SYSTEMATIC:
            return SYSTEMATIC_UNIT * coordinate
        if tail == "rate":
            return LARGEST_RATE * float(expit(coordinate))
        return float(np.exp(coordinate)) * (1.0 if tail == "dof" else self.parameters.begin[channel])

    def point(self, values: Mapping[str, float]) -> Float:
        """Return the coordinates (P,) of values; the inverse of `values`."""
        return np.array([self._coordinate(name, values[name]) for name in self.names])

    def _coordinate(self, name: str, value: float) -> float:
        channel, _, tail = name.partition(" ")
        if name in SYSTEMATIC:
            return value / SYSTEMATIC_UNIT
        if tail == "rate":
            return float(logit(value / LARGEST_RATE))
        return float(np.log(value / (1.0 if tail == "dof" else self.parameters.begin[channel])))

    def innovations(self, values: Mapping[str, float]) -> Innovations | None:
        """Return the innovations of the filter with these values; None if it cannot compute an update."""
        return self._log.innovations(*self.parameters.measurements(values), self._tails(values))

    def assumed_innovations(self) -> Innovations | None:
        """Return the innovations with the noise of the recording itself."""
        own = self.recording
        measurements = (own.odometry, own.odometry_cov, own.observation, own.observation_cov)
        return self._log.innovations(*measurements, gaussian_tails())

    def rows(self, channel: str) -> list[int]:
        """Return which of the two rows of an observation belong to a channel."""
        channels = self.parameters.channels
        return [0, 1] if len(channels) == 1 else [channels.index(channel)]

    def _tails(self, values: Mapping[str, float]) -> Tails:
        tails = gaussian_tails()
        for each in self.distributions:
            rows = self.rows(each.channel)
            if each.kind == "mixture":
                tails.law[rows] = MIXTURE
                tails.rate[rows] = values[f"{each.channel} rate"]
                tails.spread[rows] = values[f"{each.channel} spread"]
            else:
                tails.law[rows] = STUDENT_T
                tails.dof[rows] = values[f"{each.channel} dof"]
        return tails
