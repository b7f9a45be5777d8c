"""Mistakes of units, signs and clocks in an imported log, found by quick passes of the right-invariant EKF over it.

A mistake is named only where undoing it turns disagreement into agreement: from less than `DOUBTED` of the observations
to more than `CONVINCING`. The size of noise is the answer of `slamgauge noise`.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import exp, log
from slamgauge.sensors import SENSORS

BOUND = 0.999  # probability of the largest normalised innovation that agrees
DOUBTED = 0.75  # share of observations that agree, below which mistakes are tried
CONVINCING = 0.9  # smallest share with which a mistake is found
INSIDE = 0.7  # share of the observations that an offset must leave within the steps
SMALL = 0.4  # median of NIS / dof, about 0.8 if the noise is right; lower if lengths are so small that anything agrees
RESOLVED = 3.0  # smallest ratio of typical lengths and their standard deviation, below which no mistake is found
SHIFTS = tuple(0.5 * each for each in range(-10, 11) if each)  # s: offsets of two clocks that are tried
DEGREE = np.pi / 180
SIGN = "change the sign of those that are clockwise"
UNIT = "correct the unit (in recording.toml: angle, length, time)"


class Mistake(NamedTuple):
    """A mistake, the remedy, and the factors that undo it.

    Attributes:
        what: the mistake, as a sentence about the log.
        remedy: end of the error text.
        bearing: factor of bearings; -1 also mirrors positions in the body frame.
        length: factor of observed lengths.
        turn: factor of the turns of odometry.
        way: factor of its distances.
        rates: whether the turns come from yaw rates, so that the distances are chords of arcs.
    """

    what: str
    remedy: str
    bearing: float = 1.0
    length: float = 1.0
    turn: float = 1.0
    way: float = 1.0
    rates: bool = False

    @property
    def size(self) -> float:
        """Size of the numbers without the mistake, relative to those with it."""
        return round(abs(self.bearing) * self.length * self.turn * self.way, 9)


def _of_lengths(what: str, names: tuple[str, ...], scale: str, undone: float) -> Mistake:
    factors: dict[str, Any] = dict.fromkeys(names, undone)
    return Mistake(f"{what} are {scale}", UNIT, **factors)


MISTAKES = (
    Mistake("observations and odometry count angles in opposite directions", SIGN, bearing=-1.0),
    Mistake("bearings are in degrees, read as radians", UNIT, bearing=DEGREE),
    Mistake("turns are in degrees, read as radians", UNIT, turn=DEGREE),
    Mistake("yaw rates are in deg/s, read as rad/s", UNIT, turn=DEGREE, rates=True),
    Mistake("bearings and turns are in degrees, read as radians", UNIT, bearing=DEGREE, turn=DEGREE),
    Mistake("bearings are in radians, read as degrees", UNIT, bearing=1 / DEGREE),
    Mistake("turns are in radians, read as degrees", UNIT, turn=1 / DEGREE),
    Mistake("bearings and turns are in radians, read as degrees", UNIT, bearing=1 / DEGREE, turn=1 / DEGREE),
    *(
        _of_lengths(what, names, f"{factor:g} times too {size}", undone)
        for what, names in {
            "observed lengths": ("length",),
            "distances of the odometry": ("way",),
            "all lengths": ("length", "way"),
            "turns and distances of the odometry": ("turn", "way"),
        }.items()
        for factor in (1000, 100)
        for size, undone in (("large", 1 / factor), ("small", float(factor)))
    ),
)


class Fit(NamedTuple):
    """How well an estimate fits the observations; 0 without an estimate."""

    share: float  # share of the observations that agree
    nis: float  # median of NIS / dof of the steps
    mean: float  # mean of NIS / dof; 1 with the right noise
    deviation: float  # deviation of the mean from 1, in its standard deviations


def quick_fit(recording: Recording) -> tuple[Fit, Estimate | None]:
    """Return how well the filter fits observations that do not add landmarks, and its estimate (None if it fails)."""
    with redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        try:
            estimate = riekf(recording)
        except UserError:
            return Fit(0.0, 0.0, 0.0, 0.0), None
    nis, dof = estimate.nis, estimate.nis_dof
    if nis is None or dof is None or not dof.any():
        return Fit(1.0, 0.0, 1.0, 0.0), estimate
    counts = np.bincount(recording.observation_step, minlength=recording.steps + 1)[dof > 0]
    nis, dof = nis[dof > 0], dof[dof > 0]
    share = float(np.average(nis < chi2.ppf(BOUND, dof), weights=counts))
    mean = float(nis.sum() / dof.sum())
    return Fit(share, float(np.median(nis / dof)), mean, (mean - 1.0) * float(np.sqrt(dof.sum() / 2.0))), estimate


def refuse_mistakes(recording: Recording, stated: Fit) -> None:
    """Refuse a recording that agrees with one place per landmark once a mistake of units or signs is undone.

    Raises:
        UserError: with the mistake and its remedy.
    """
    if stated.share >= DOUBTED:
        return
    undone = ((each, _without(recording, each)) for each in MISTAKES)
    fits = {each: quick_fit(other)[0] for each, other in undone if not _lengths_are_noise(other)}
    found = {each: fit for each, fit in fits.items() if fit.share > CONVINCING and fit.nis > SMALL}
    # small numbers agree with everything, so the largest are the strongest evidence
    best = max(found, key=lambda each: (each.size, -abs(np.log(found[each].nis))), default=None)
    if best:
        what = f"{stated.share:.1%} of the observations agree with one place per landmark"
        raise UserError(f"{what}, but {found[best].share:.1%} if {best.what}; {best.remedy}")


def clock_offset(recording: Recording, stated: Fit) -> str:
    """Return with which offset of their stamps the observations agree with one place per landmark; "" if with none."""
    if stated.share >= DOUBTED or _lengths_are_noise(recording):
        return ""
    fits = {shift: quick_fit(_shifted(recording, shift))[0] for shift in SHIFTS if _most_are_inside(recording, shift)}
    if not fits:
        return ""
    best = max(fits, key=lambda shift: (fits[shift].share, -fits[shift].mean))
    if fits[best].share <= CONVINCING:
        return ""
    what = f"{stated.share:.1%} of the observations agree with one place per landmark, but {fits[best].share:.1%}"
    remedy = "give both files the same clock"
    return f"{what} if their stamps are {abs(best):g} s {'late' if best < 0.0 else 'early'}; {remedy}"


def _most_are_inside(recording: Recording, shift: float) -> bool:
    """Return whether most observations are within the steps if they are shifted by some seconds."""
    at = recording.stamps[recording.observation_step] + shift
    return float(np.mean((at >= recording.stamps[0]) & (at <= recording.stamps[-1]))) > INSIDE


def _lengths_are_noise(recording: Recording) -> bool:
    """Return whether typical observed lengths are below `RESOLVED` standard deviations: most paths agree with them."""
    lengths = [column != "bearing" for column in SENSORS[recording.sensor].columns]
    sigmas = np.sqrt(np.diagonal(recording.observation_cov, axis1=1, axis2=2))
    return any(lengths) and bool(np.median(np.abs(recording.observation / sigmas)[:, lengths]) < RESOLVED)


def _without(recording: Recording, mistake: Mistake) -> Recording:
    """Return the recording without a mistake."""
    columns = SENSORS[recording.sensor].columns
    of_column = dict.fromkeys(("range", "x", "y"), mistake.length) | {"bearing": mistake.bearing}
    if mistake.bearing < 0.0:
        of_column["y"] *= mistake.bearing
    observation = recording.observation * np.array([of_column[name] for name in columns])
    factors = np.array([mistake.way, mistake.way, mistake.turn])
    odometry = exp(log(recording.odometry) * factors) if mistake.rates else recording.odometry * factors
    return replace(recording, odometry=odometry, observation=observation)


def _shifted(recording: Recording, shift: float) -> Recording:
    """Return the recording with its observations at the steps nearest to `shift` seconds later, if they exist."""
    stamps, rows = recording.stamps, recording.observation_step
    at = stamps[rows] + shift
    kept = (at >= stamps[0]) & (at <= stamps[-1])
    return replace(
        recording,
        observation_step=np.rint(np.interp(at[kept], stamps, np.arange(len(stamps)))).astype(rows.dtype),
        observation=recording.observation[kept],
        observation_cov=recording.observation_cov[kept],
        landmark=None if recording.landmark is None else recording.landmark[kept],
    )
