"""Likelihood of a recording as a function of its noise and its systematic errors: maximum and profile intervals.

iminuit's MIGRAD searches the maximum. MINOS finds the ends of an interval: the values of a parameter at which twice the
log-likelihood, maximised over all others, is 3.84 below its maximum. Both work with coordinates: a sigma divided by the
assumed one, and a systematic error divided by its unit. The sign of a sigma's coordinate has no effect, so that the
likelihood is smooth where a sigma is 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from iminuit import Minuit

from slamgauge.arrays import Float
from slamgauge.compare.noise.parameters import SYSTEMATIC, NoiseParameters
from slamgauge.compare.scoring.intervals import LEVEL, Interval
from slamgauge.ekf.innovations import Innovations, Log
from slamgauge.recording import Recording

SYSTEMATIC_UNIT = 0.01  # a coordinate of 1 is large, as for sigmas
LIMIT = 100.0  # largest coordinate; the log does not determine an end beyond it
FIRST_STEP = 0.1  # first step of the search
IMPOSSIBLE = 1e12  # cost of noise with which the filter cannot compute an update


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """A recording with ids as a function of its noise, and of systematic errors if `systematic`."""

    recording: Recording
    systematic: bool = False

    @cached_property
    def parameters(self) -> NoiseParameters:
        """Noise parameters of the recording."""
        return NoiseParameters(self.recording)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """(P,) names of the values: sigmas, and systematic errors."""
        return (*self.parameters.sigmas, *(SYSTEMATIC if self.systematic else ()))

    @cached_property
    def _log(self) -> Log:
        return Log(self.recording)

    def value(self, name: str, coordinate: float) -> float:
        """Return the value of a coordinate, in its unit."""
        if name in SYSTEMATIC:
            return SYSTEMATIC_UNIT * coordinate
        return abs(coordinate) * self.parameters.begin[name]

    def values(self, point: Iterable[float]) -> dict[str, float]:
        """Return all values by name, in their units, at coordinates (P,)."""
        return {name: self.value(name, each) for name, each in zip(self.names, point, strict=True)}

    def innovations(self, values: Mapping[str, float]) -> Innovations | None:
        """Return the innovations of the filter with these values; None if it cannot compute an update."""
        return self._log.innovations(*self.parameters.measurements(values))

    def assumed_innovations(self) -> Innovations | None:
        """Return the innovations with the noise of the recording itself."""
        own = self.recording
        return self._log.innovations(own.odometry, own.odometry_cov, own.observation, own.observation_cov)


class Fit:
    """The most likely noise of a model: `values` by name, in their units."""

    def __init__(self, model: NoiseModel) -> None:
        self.model = model
        cost: Any = self._cost  # iminuit's types want a function of many numbers
        start = [0.0 if name in SYSTEMATIC else 1.0 for name in model.names]
        self._minuit = Minuit(cost, start, name=model.names)
        self._minuit.errordef = Minuit.LIKELIHOOD
        self._minuit.errors = [FIRST_STEP] * len(model.names)
        self._minuit.limits = [(-LIMIT, LIMIT)] * len(model.names)
        self._minuit.migrad()
        for name in model.parameters.sigmas:  # to the side where an interval has its lower end below
            self._minuit.values[name] = abs(self._minuit.values[name])
        self._minuit.migrad()
        self.values = model.values(self._minuit.values)

    def _cost(self, point: Float) -> float:
        found = self.model.innovations(self.model.values(point))
        return IMPOSSIBLE if found is None else -float(found.log_likelihood.sum())

    def innovations(self) -> Innovations:
        """Return the innovations with the most likely noise."""
        found = self.model.innovations(self.values)
        assert found is not None, "the filter computed an update with this noise before"
        return found

    def interval(self, name: str) -> Interval:
        """Return a value with its 95 % profile likelihood interval.

        An end that the log does not determine is None. The low end of a sigma is 0 if all smaller values are as likely.
        """
        self._minuit.minos(name, cl=LEVEL)
        found, best = self._minuit.merrors[name], self._minuit.values[name]
        ends = (best + found.lower, best + found.upper)
        low = self.model.value(name, ends[0]) if found.lower_valid and not found.at_lower_limit else None
        high = self.model.value(name, ends[1]) if found.upper_valid and not found.at_upper_limit else None
        if name not in SYSTEMATIC and ends[0] * ends[1] <= 0.0:
            low = 0.0
        return Interval(self.values[name], low, high)
