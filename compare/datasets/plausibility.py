"""Doubts about an imported log: units, signs, ids and noise that its own measurements contradict.

A quick pass of the right-invariant EKF over the beginning of a log with ids shows whether the observations agree with
one place per landmark. If they do not, the pass is repeated for every mistake in `MISTAKES`; a log that agrees once a
mistake is undone is refused. All other doubts are warnings. If the mean NIS differs from that of the stated noise, the
pass is repeated with variances instead of standard deviations, and the reverse, and with shifted observations.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import redirect_stderr
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.imported_log import Imported, of_file
from slamgauge.compare.storage.path_doubts import path_doubts
from slamgauge.ekf import riekf
from slamgauge.ekf.kernels.warm_up import compile_ekf
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import rotation
from slamgauge.sensors import SENSORS, innovation, predict
from slamgauge.truth import Truth

FEW, PASS = 20, 2000  # observations: fewer show no doubts; observations of a quick pass
BOUND = 0.999  # probability of the largest normalised innovation that agrees
DOUBTED = 0.95  # share of observations that agree, below which mistakes are tried; published logs have 0.97 or more
CONVINCING = 0.9  # smallest share with which a mistake is found
POOR = 0.8  # share below which a log without a known mistake is warned of
NOISE = 20.0  # factor between residuals and stated noise
FASTEST, QUICKEST, LONGEST = 50.0, 2.0 * np.pi, 10.0  # m/s, rad/s, s: typical speed and step, large yaw rate
FARTHEST = 1e9  # m from the origin
SMALL = 0.4  # median of NIS / dof, about 0.8 if the noise is right; lower if lengths are so small that anything agrees
RESOLVED = 3.0  # smallest ratio of typical lengths and their standard deviation, below which no mistake is found
COVERED = 0.5  # share of the steps with a true pose, below which a warning is printed
DIFFERS, EQUALS = 3.0, 2.5  # deviations of the mean NIS from its expected value: not the stated noise, the right noise
LEAST = 0.15  # median of NIS / dof, below which the stated noise is doubted
EXPLAINED = 0.5  # factor of the median NIS, below which a mistake explains deviations
STATED = "standard deviations"
LARGEST_LOG = 50.0  # of a range
SHIFTS = tuple(0.5 * each for each in range(-10, 11) if each)  # s: offsets of two clocks that are tried
MEDIAN = 0.6745  # of the absolute value of a standard normal number
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


class Examination(NamedTuple):
    """What the measurements of a log show.

    Attributes:
        facts: values by their names.
        warnings: sentences about doubts, each with a remedy.
    """

    facts: dict[str, str]
    warnings: tuple[str, ...]


def examine(log: Imported, path: Path) -> Examination:
    """Return facts and doubts about the log of a path.

    Raises:
        UserError: the observations agree with one place per landmark only if a mistake of `MISTAKES` is undone.
    """
    recording = log.recording
    doubled = _doubled(recording)
    facts = {
        "steps": f"{recording.steps} in {np.ptp(recording.stamps):.6g} s",
        "largest turn in a step": f"{np.rad2deg(np.abs(recording.odometry[:, 2]).max(initial=0.0)):.3g} deg",
        "observations": f"{len(recording.observation)} within the steps, {log.unmatched} outside",
        "doubled observations": str(doubled),
    }
    if SENSORS[recording.sensor].has_bearing and len(recording.observation):
        low, high = np.rad2deg([recording.observation[:, -1].min(), recording.observation[:, -1].max()])
        facts["bearings"] = f"{low:.1f} to {high:.1f} deg"
    warnings = [*_doubts_of_motion(recording)]
    if doubled:
        same = "the step, landmark and values of another one"
        warnings.append(f"{doubled} observations have {same} and count twice; remove them")
    if log.truth is not None:
        warnings += _doubts_of_truth(log.truth, recording)
    if not len(recording.observation):
        warnings.append("there are no observations: every filter then equals dead reckoning; check the file")
    elif recording.landmark is not None:
        beginning = _beginning(recording)
        with of_file(path):
            share, more = _agreement(beginning)
        facts["agree with one place per landmark"] = f"{share:.1%} of the first {len(beginning.observation)}"
        warnings += more
    return Examination(facts, tuple(warnings))


def _doubled(recording: Recording) -> int:
    """Return the number of observations that repeat another one of their step."""
    ids = np.zeros(len(recording.observation)) if recording.landmark is None else recording.landmark
    rows = np.column_stack([recording.observation_step, ids, recording.observation])
    return len(rows) - len(np.unique(rows, axis=0))


def _doubts_of_motion(recording: Recording) -> Iterator[str]:
    """Yield doubts about the start, and the durations, speeds and turns of the steps."""
    far = float(np.abs(recording.prior_mean[:2]).max())
    if far > FARTHEST:
        yield f"the start is {far:.3g} m from the origin, where centimetres are rounded; begin nearer to it"
    seconds = np.diff(recording.stamps)
    if np.median(seconds) > LONGEST:
        yield f"half of the steps take over {np.median(seconds):.3g} s; check the unit of stamps"
    speeds = np.hypot(*recording.odometry[:, :2].T) / seconds
    moving = speeds[speeds > 0.0]
    if len(moving) and np.median(moving) > FASTEST:
        yield f"the typical speed is {np.median(moving):.3g} m/s; check the units of lengths and stamps"
    distance = float(np.quantile(speeds * seconds, 0.9))
    sigma = float(np.median(np.sqrt(recording.odometry_cov[:, 0, 0])))
    if sigma > NOISE * distance > 0.0:
        what = f"the typical standard deviation of a step is {sigma:.3g} m, and its distance {distance:.3g} m"
        yield f"{what}; correct the noise (variance, standard deviation or information?)"
    rate = float(np.quantile(np.abs(recording.odometry[:, 2]) / seconds, 0.9))
    if rate > QUICKEST:
        yield f"the robot often turns at {np.rad2deg(rate):.3g} deg/s; check the units of angles and stamps"


def _doubts_of_truth(truth: Truth, recording: Recording) -> Iterator[str]:
    """Yield doubts about the true path and the true map."""
    if truth.poses is None:
        return
    known = int(np.sum(np.isfinite(truth.poses).all(axis=1)))
    if known < COVERED * len(truth.poses):
        yield f"the true path has poses at {known} of {len(truth.poses)} steps; only these are scored"
    yield from (f"the true path {doubt}" for doubt in path_doubts(truth.poses, recording))
    if truth.landmarks is None or truth.landmark_ids is None:
        return
    for name, ratio in _residuals(recording, truth.poses, truth.landmark_ids, truth.landmarks).items():
        if ratio > NOISE:
            what = f"the residuals of {name} with the true path and map are {ratio:.2g} times its stated noise"
            yield f"{what}; check ids, units, axes and stamps of the truth"


def _beginning(recording: Recording) -> Recording:
    """Return the steps with the first `PASS` observations."""
    if len(recording.observation) <= PASS:
        return recording
    return recording.first(int(recording.observation_step[PASS]))


def _agreement(recording: Recording) -> tuple[float, list[str]]:
    """Return the share of observations that agree with one place per landmark, and doubts.

    Raises:
        UserError: they agree once a mistake is undone.
    """
    compile_ekf()  # its messages are shown, those of the passes are not
    estimate = _pass(recording)
    fit = _fit(recording, estimate)
    share = fit.share
    if len(recording.observation) < FEW:
        return share, []
    if estimate is not None and estimate.nis_dof is not None and not estimate.nis_dof.any():
        return share, ["no landmark is observed at two steps: nothing corrects the path; check the ids"]
    if share < DOUBTED:
        undone = {each: _without(recording, each) for each in MISTAKES}
        fits = {each: _fit(other, _pass(other)) for each, other in undone.items() if not _lengths_are_noise(other)}
        enough = max(CONVINCING, 0.5 + 0.5 * share)
        found = {each: fit for each, fit in fits.items() if fit.share > enough and fit.nis > SMALL}
        best = min(found, key=lambda each: abs(np.log(found[each].nis)), default=None)  # with tiny lengths all agrees
        if best and (abs(found[best].deviation) < EQUALS or not _explained(recording, fit)):
            what = f"{share:.1%} of the observations agree with one place per landmark, but {found[best].share:.1%} if"
            raise UserError(f"{what} {best.what}; {best.remedy}")
    doubts = [] if estimate is None else [*_doubts_of_noise(recording, estimate)]
    explained = _explained(recording, fit)
    if explained:
        doubts.append(explained)
    elif 0.0 < fit.nis < LEAST:
        what = f"the median NIS / dof is {fit.nis:.2g}, about 0.8 with the right noise"
        doubts.append(f"{what}; correct the stated noise, which is too large (variance, standard deviation?)")
    if share < POOR:
        what = f"only {share:.1%} of the observations agree with one place per landmark"
        doubts.append(f"{what}; check units, signs, stamps and ids, and the stated noise")
    return share, doubts


def _lengths_are_noise(recording: Recording) -> bool:
    """Return whether typical observed lengths are below `RESOLVED` standard deviations: most paths agree with them."""
    lengths = [column != "bearing" for column in SENSORS[recording.sensor].columns]
    sigmas = np.sqrt(np.diagonal(recording.observation_cov, axis1=1, axis2=2))
    return any(lengths) and bool(np.median(np.abs(recording.observation / sigmas)[:, lengths]) < RESOLVED)


def _pass(recording: Recording) -> Estimate | None:
    """Return the estimate of the right-invariant EKF; None if it has none in double precision."""
    with redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        try:
            return riekf(recording)
        except UserError:
            return None


class Fit(NamedTuple):
    """How well an estimate fits the observations; 0 without an estimate.

    Attributes:
        share: share of the observations that agree.
        nis: median of NIS / dof of the steps.
        deviation: mean of NIS / dof less 1, in standard deviations of the mean.
    """

    share: float
    nis: float
    deviation: float


def _fit(recording: Recording, estimate: Estimate | None) -> Fit:
    """Return how well an estimate fits the observations; those that add landmarks do not count."""
    if estimate is None or estimate.nis is None or estimate.nis_dof is None:
        return Fit(0.0, 0.0, 0.0)
    updated = estimate.nis_dof > 0
    if not updated.any():
        return Fit(1.0, 0.0, 0.0)
    nis, dof = estimate.nis[updated], estimate.nis_dof[updated]
    counts = np.bincount(recording.observation_step, minlength=recording.steps + 1)[updated]
    share = float(np.average(nis < chi2.ppf(BOUND, dof), weights=counts))
    return Fit(share, float(np.median(nis / dof)), float((nis.sum() / dof.sum() - 1.0) * np.sqrt(dof.sum() / 2.0)))


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


def _explained(recording: Recording, stated: Fit) -> str:
    """Return which mistake explains a mean NIS that is not that of the stated noise; "" if none does."""
    if abs(stated.deviation) < DIFFERS:
        return ""
    if SENSORS[recording.sensor].has_range and stated.deviation > 0.0:
        undone = _without(recording, LOGARITHMS)
        if 0.0 < _fit(undone, _pass(undone)).nis < EXPLAINED * stated.nis:
            return f"the observations fit better if {LOGARITHMS.what}; {LOGARITHMS.remedy}"
    if stated.deviation > 0.0 and (offset := _offset(recording)):
        return offset
    columns = SENSORS[recording.sensor].columns
    every, none = np.ones(len(columns), dtype=bool), np.zeros(len(columns), dtype=bool)
    seconds = np.diff(recording.stamps)
    growths = [np.ones_like(seconds), np.sqrt(seconds), seconds]  # of odometry's noise: per step, second or speed
    parts: list[tuple[str, Marks, Float | None]] = [("observations", every, None)]
    if recording.sensor == "range-bearing":
        parts += [(name, each, None) for name, each in zip(columns, np.eye(len(columns), dtype=bool), strict=True)]
    parts += [("odometry", none, each) for each in growths] + [("all measurements", every, each) for each in growths]
    found: dict[str, float] = {}
    for what, of_sensor, growth in parts:
        for power, stated_as, meant in ((0.5, STATED, "variances"), (2.0, "variances", STATED)):
            other = replace(
                recording,
                observation_cov=_with_power(recording.observation_cov, np.where(of_sensor, power, 1.0), 1.0),
                odometry_cov=recording.odometry_cov
                if growth is None
                else _with_power(recording.odometry_cov, np.full(3, power), growth[:, None]),
            )
            fit = _fit(other, _pass(other))
            if fit.share > DOUBTED:
                text = f"the stated {stated_as} of {what} are {meant}"
                found[text] = min(found.get(text, np.inf), abs(fit.deviation))
    best = min(found, key=lambda each: found[each], default="")
    does_fit = bool(best) and found[best] < EQUALS
    return f"the measurements do not fit their stated noise, but do if {best}; correct the noise" if does_fit else ""


def _offset(recording: Recording) -> str:
    """Return with which offset of their stamps the observations fit the stated noise; "" if with none.

    Larger noise than the stated one also explains an offset, but no offset explains noise.
    """
    fits = {shift: _fit(other, _pass(other)) for shift in SHIFTS for other in [_shifted(recording, shift)]}
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


def _with_power(covs: Float, powers: Float, unit: Float | float) -> Float:
    """Return covariances (n, d, d) with powers (d,) of their standard deviations, and the same correlations.

    Args:
        covs: (n, d, d).
        powers: (d,).
        unit: standard deviation, which the power does not change; (n, 1) or a number.
    """
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2)) / unit
    factors = np.where(sigmas > 0.0, sigmas, 1.0) ** (powers - 1.0)
    return covs * factors[:, :, None] * factors[:, None, :]


def _doubts_of_noise(recording: Recording, estimate: Estimate) -> Iterator[str]:
    """Yield the quantities whose residuals, with the filtered poses and the last map, are far from the stated noise."""
    ratios = _residuals(recording, estimate.poses, estimate.landmark_ids, estimate.landmarks)
    for name, ratio in ratios.items():
        if not 1.0 / NOISE <= ratio <= NOISE:
            yield f"the residuals of {name} are {ratio:.2g} times its stated noise; correct the noise or the unit"


def _residuals(recording: Recording, poses: Float, ids: Int, landmarks: Float) -> dict[str, float]:
    """Return the typical residual of each quantity, in standard deviations; nothing without a known landmark.

    Args:
        recording: observations with ids.
        poses: (N+1, 3); rows of NaN are not used.
        ids: (L,) of the landmarks.
        landmarks: (L, 2) [m].
    """
    model = SENSORS[recording.sensor]
    if recording.landmark is None or not len(ids):
        return {}
    order = np.argsort(ids)
    at = order[np.searchsorted(ids, recording.landmark, sorter=order).clip(max=len(ids) - 1)]
    seen_from = poses[recording.observation_step]
    rows = (ids[at] == recording.landmark) & np.isfinite(seen_from).all(axis=1)
    if not rows.any():
        return {}
    ahead = landmarks[at[rows]] - seen_from[rows, :2]
    delta = np.einsum("nji,nj->ni", rotation(seen_from[rows, 2]), ahead)
    residuals = innovation(model.name, recording.observation[rows], predict(model.name, delta))
    sigmas = np.sqrt(np.diagonal(recording.observation_cov[rows], axis1=1, axis2=2))
    return dict(zip(model.columns, np.median(np.abs(residuals) / sigmas, axis=0) / MEDIAN, strict=True))
