"""Mistakes in an imported log, found by quick passes of the right-invariant EKF over it.

`refuse_mistakes` repeats the pass for every mistake in `MISTAKES` if the observations do not agree with one place per
landmark. If the mean NIS differs from that of the stated noise, `wrong_noise` repeats it with shifted observations, and
with variances instead of the standard deviations in `STATED_NOISE`, and the reverse.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS

BOUND = 0.999  # probability of the largest normalised innovation that agrees
DOUBTED = 0.95  # share of observations that agree, below which mistakes are tried; published logs have 0.97 or more
CONVINCING = 0.9  # smallest share with which a mistake is found
SMALL = 0.4  # median of NIS / dof, about 0.8 if the noise is right; lower if lengths are so small that anything agrees
RESOLVED = 3.0  # smallest ratio of typical lengths and their standard deviation, below which no mistake is found
DIFFERS, EQUALS = 3.0, 2.5  # deviations of the mean NIS from its expected value: not the stated noise, the right noise
EXPLAINED = 0.5  # factor of the median NIS, below which a mistake explains deviations
LARGEST_LOG = 50.0  # largest logarithm of a range
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
    """

    what: str
    remedy: str
    bearing: float = 1.0
    length: float = 1.0
    turn: float = 1.0
    way: float = 1.0


LOGARITHMS = Mistake("ranges are logarithms of ranges", "write ranges in metres")  # no factor
MISTAKES = (
    LOGARITHMS,
    Mistake("observations and odometry count angles in opposite directions", SIGN, bearing=-1.0),
    Mistake("bearings are in degrees, read as radians", UNIT, bearing=DEGREE),
    Mistake("turns are in degrees, read as radians", UNIT, turn=DEGREE),
    Mistake("bearings and turns are in degrees, read as radians", UNIT, bearing=DEGREE, turn=DEGREE),
    Mistake("bearings are in radians, read as degrees", UNIT, bearing=1 / DEGREE),
    Mistake("turns are in radians, read as degrees", UNIT, turn=1 / DEGREE),
    Mistake("bearings and turns are in radians, read as degrees", UNIT, bearing=1 / DEGREE, turn=1 / DEGREE),
    *(
        Mistake(f"{what} are {factor:g} times too {size}", UNIT, **dict.fromkeys(names, undone))
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

COLUMNS = ("range", "bearing", "x", "y")
GROWTHS = (0.0, 0.5, 1.0)  # powers of a step's duration: noise per step, per second, or per speed
# parts that may have a wrong form of noise: name, columns of observations (and the odometry), power of the duration
STATED_NOISE = (
    ("observations", COLUMNS, 0.0),
    ("range", ("range",), 0.0),
    ("bearing", ("bearing",), 0.0),
    *(("odometry", ("odometry",), growth) for growth in GROWTHS),
    *(("all measurements", (*COLUMNS, "odometry"), growth) for growth in GROWTHS),
)
# power of the stated standard deviations that corrects the form, the stated form, and the right form
FORMS = ((0.5, "standard deviations", "variances"), (2.0, "variances", "standard deviations"))


class Fit(NamedTuple):
    """How well an estimate fits the observations; 0 without an estimate."""

    share: float  # share of the observations that agree
    nis: float  # median of NIS / dof of the steps
    deviation: float  # mean of NIS / dof less 1, in standard deviations of the mean


def quick_fit(recording: Recording) -> tuple[Fit, Estimate | None]:
    """Return how well the filter fits observations that do not add landmarks, and its estimate (None if it fails)."""
    with redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        try:
            estimate = riekf(recording)
        except UserError:
            return Fit(0.0, 0.0, 0.0), None
    nis, dof = estimate.nis, estimate.nis_dof
    if nis is None or dof is None or not dof.any():
        return Fit(1.0, 0.0, 0.0), estimate
    counts = np.bincount(recording.observation_step, minlength=recording.steps + 1)[dof > 0]
    nis, dof = nis[dof > 0], dof[dof > 0]
    share = float(np.average(nis < chi2.ppf(BOUND, dof), weights=counts))
    deviation = float((nis.sum() / dof.sum() - 1.0) * np.sqrt(dof.sum() / 2.0))
    return Fit(share, float(np.median(nis / dof)), deviation), estimate


def refuse_mistakes(recording: Recording, stated: Fit) -> None:
    """Refuse a recording that agrees with one place per landmark once a mistake is undone.

    Raises:
        UserError: with the mistake and its remedy.
    """
    if stated.share >= DOUBTED:
        return
    undone = ((each, _without(recording, each)) for each in MISTAKES)
    fits = {each: quick_fit(other)[0] for each, other in undone if not _lengths_are_noise(other)}
    enough = max(CONVINCING, 0.5 + 0.5 * stated.share)
    found = {each: fit for each, fit in fits.items() if fit.share > enough and fit.nis > SMALL}
    best = min(found, key=lambda each: abs(np.log(found[each].nis)), default=None)  # with tiny lengths all agrees
    if best and (abs(found[best].deviation) < EQUALS or not wrong_noise(recording, stated)):
        what = f"{stated.share:.1%} of the observations agree with one place per landmark"
        raise UserError(f"{what}, but {found[best].share:.1%} if {best.what}; {best.remedy}")


def _lengths_are_noise(recording: Recording) -> bool:
    """Return whether typical observed lengths are below `RESOLVED` standard deviations: most paths agree with them."""
    lengths = [column != "bearing" for column in SENSORS[recording.sensor].columns]
    sigmas = np.sqrt(np.diagonal(recording.observation_cov, axis1=1, axis2=2))
    return any(lengths) and bool(np.median(np.abs(recording.observation / sigmas)[:, lengths]) < RESOLVED)


def _without(recording: Recording, mistake: Mistake) -> Recording:
    """Return the recording without a mistake."""
    columns = SENSORS[recording.sensor].columns
    factors = dict.fromkeys(("range", "x", "y"), mistake.length) | {"bearing": mistake.bearing}
    if mistake.bearing < 0.0:
        factors["y"] *= mistake.bearing
    observation = recording.observation * np.array([factors[name] for name in columns])
    if mistake == LOGARITHMS and SENSORS[recording.sensor].has_range:
        observation[:, 0] = np.exp(np.minimum(observation[:, 0], LARGEST_LOG))
    odometry = recording.odometry * np.array([mistake.way, mistake.way, mistake.turn])
    return replace(recording, odometry=odometry, observation=observation)


def wrong_noise(recording: Recording, stated: Fit) -> str:
    """Return which mistake explains a mean NIS that is not that of the stated noise; "" if none does."""
    if abs(stated.deviation) < DIFFERS:
        return ""
    may_be_logarithms = SENSORS[recording.sensor].has_range and stated.deviation > 0.0
    if may_be_logarithms and 0.0 < quick_fit(_without(recording, LOGARITHMS))[0].nis < EXPLAINED * stated.nis:
        return f"the observations fit better if {LOGARITHMS.what}; {LOGARITHMS.remedy}"
    if stated.deviation > 0.0 and (offset := _offset(recording)):
        return offset
    best, smallest = "", EQUALS
    for what, columns, growth in STATED_NOISE:
        for power, form, meant in FORMS:
            fit, _ = quick_fit(_with_power(recording, power, columns, growth))
            if fit.share > DOUBTED and abs(fit.deviation) < smallest:
                best, smallest = f"the stated {form} of {what} are {meant}", abs(fit.deviation)
    return f"the measurements do not fit their stated noise, but do if {best}; correct the noise" if best else ""


def _offset(recording: Recording) -> str:
    """Return with which offset of their stamps the observations fit the stated noise; "" if with none.

    Larger noise than the stated one also explains an offset, but no offset explains noise.
    """
    fits = {shift: quick_fit(_shifted(recording, shift))[0] for shift in SHIFTS}
    found = {shift: abs(fit.deviation) for shift, fit in fits.items() if fit.share > DOUBTED}
    best = min(found, key=lambda each: found[each], default=0.0)
    if found.get(best, np.inf) > EQUALS:
        return ""
    what = f"have stamps about {abs(best):g} s {'late' if best < 0.0 else 'early'}"
    return f"the measurements fit their stated noise if observations {what}; give both files the same clock"


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


def _with_power(recording: Recording, power: float, columns: tuple[str, ...], growth: float) -> Recording:
    """Return the recording with a power of some standard deviations (see `STATED_NOISE`), and the same correlations."""

    def changed(covs: Float, names: tuple[str, ...], unit: Float | float) -> Float:
        powers = np.array([power if name in columns else 1.0 for name in names])
        sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2)) / unit  # a power of 1 keeps its value
        factors = np.where(sigmas > 0.0, sigmas, 1.0) ** (powers - 1.0)
        return covs * factors[:, :, None] * factors[:, None, :]

    observation_cov = changed(recording.observation_cov, SENSORS[recording.sensor].columns, 1.0)
    durations = np.diff(recording.stamps)[:, None] ** growth
    odometry_cov = changed(recording.odometry_cov, ("odometry",) * 3, durations)
    return replace(recording, observation_cov=observation_cov, odometry_cov=odometry_cov)
