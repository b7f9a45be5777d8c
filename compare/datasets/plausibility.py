"""Doubts about an imported log or a path: units, signs, ids and clocks that the log's own measurements contradict.

Where observations have ids, quick passes of the right-invariant EKF over the beginning of a log find mistakes. One is
named only where undoing it turns disagreement into agreement: from less than `DOUBTED` of the observations to more than
`CONVINCING`. A log with a mistake of units or signs is refused, all other doubts are warnings. The size of noise is the
answer of `slamgauge noise`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Imported, of_file
from slamgauge.ekf import riekf
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, exp, in_body, log
from slamgauge.sensors import SENSORS, innovation, predict
from slamgauge.truth import Truth

PASS = 2000  # observations of a quick pass
NOISE = 20.0  # factor between residuals and stated noise
FASTEST, QUICKEST, LONGEST = 50.0, 2.0 * np.pi, 10.0  # m/s, rad/s, s: typical speed and step, large yaw rate
COVERED = 0.5  # share of the steps with a true pose, below which a warning is printed
MEDIAN = 0.6745  # median of the absolute value of a standard normal number
MOST = 2.0  # largest ratio, or inverse ratio, of motions that are the same but for errors
START = np.array([1.0, 1.0, 0.5])  # m, m, rad: a start that is farther from the prior's mean than this and 6 sigmas
SIGNAL = 4.0  # smallest ratio of the odometry's squares to its variances; below it the odometry is mostly noise,
CORRELATED = 0.8  # unless the square of its correlation with a path is larger than this
LATE = np.arange(-50, 51) / 10.0  # s: offsets of a path's clock that are tried
CLEARLY, TURNING = 4.0, 0.02  # ratio of mean squares that makes an offset clear; rad in a second that differ visibly
FEW = 20  # observations, steps or seconds: fewer show no doubts
BOUND = 0.999  # probability of the largest normalised innovation that agrees
DOUBTED = 0.75  # share of observations that agree, below which mistakes are tried
CONVINCING = 0.9  # smallest share with which a mistake is found; below it a log without one is warned of
POOR_BEARINGS = 0.5  # the same for bearing-only landmarks, with which the filter of the pass is itself inconsistent
DIFFERS, FACTOR = 3.0, 0.1  # deviation of the mean NIS in its standard deviations, and from 1: the noise does not fit
INSIDE = 0.7  # smallest share of the observations that an offset leaves within the steps
SMALL = 0.4  # median of NIS / dof, about 0.8 if the noise is right; lower if lengths are so small that anything agrees
RESOLVED = 3.0  # smallest ratio of typical lengths and their standard deviation, below which no mistake is found
DEGREE = np.pi / 180
PLACE = "of the observations agree with one place per landmark"


def examine(log: Imported, path: Path) -> tuple[dict[str, str], list[str]]:
    """Return facts about the log of a path by their names, and sentences about doubts, each with a remedy.

    Raises:
        UserError: the observations agree with one place per landmark only if a mistake of `MISTAKES` is undone.
    """
    recording = log.recording
    count = len(recording.observation)
    ids = np.zeros(count) if recording.landmark is None else recording.landmark
    rows = np.column_stack([recording.observation_step, ids, recording.observation])
    doubled = count - len(np.unique(rows, axis=0))
    facts = {
        "steps": f"{recording.steps} in {np.ptp(recording.stamps):.6g} s",
        "largest turn in a step": f"{np.rad2deg(np.abs(recording.odometry[:, 2]).max(initial=0.0)):.3g} deg",
        "observations": f"{count} within the steps",
        "doubled observations": str(doubled),
    }
    doubts = [*_of_motion(recording)]
    if doubled:
        doubts.append(f"{doubled} observations repeat step, landmark and values of another one; remove them")
    if log.truth is not None:
        doubts += _of_truth(log.truth, recording)
    if not count:
        return facts, [*doubts, "there are no observations: every filter then equals dead reckoning; check the file"]
    if SENSORS[recording.sensor].has_bearing:
        low, high = np.rad2deg([recording.observation[:, -1].min(), recording.observation[:, -1].max()])
        facts["bearings"] = f"{low:.1f} to {high:.1f} deg"
    if recording.landmark is not None:
        beginning = recording.first(int(recording.observation_step[PASS])) if count > PASS else recording
        with of_file(path):
            share, doubt = agreement(beginning)
        facts["agree with one place per landmark"] = f"{share:.1%} of the first {len(beginning.observation)}"
        doubts += [doubt] if doubt else []
    return facts, doubts


def _of_motion(recording: Recording) -> Iterator[str]:
    """Yield doubts about the durations, speeds, noise and turns of the steps."""
    seconds = np.diff(recording.stamps)
    if np.median(seconds) > LONGEST:
        yield f"half of the steps take over {np.median(seconds):.3g} s; check the unit of stamps"
    ways = np.hypot(*recording.odometry[:, :2].T)
    speeds = (ways / seconds)[ways > 0.0]
    if len(speeds) and np.median(speeds) > FASTEST:
        yield f"the typical speed is {np.median(speeds):.3g} m/s; check the units of lengths and stamps"
    rate = np.quantile(np.abs(recording.odometry[:, 2]) / seconds, 0.9)
    if rate > QUICKEST:
        yield f"the robot often turns at {np.rad2deg(rate):.3g} deg/s; check the units of angles and stamps"


def _of_truth(truth: Truth, recording: Recording) -> Iterator[str]:
    """Yield doubts about the true path and the true map."""
    if truth.poses is None:
        return
    known = int(np.sum(np.isfinite(truth.poses[:, :2]).all(axis=1)))
    if known < COVERED * len(truth.poses):
        yield f"the true path has poses at {known} of {len(truth.poses)} steps; only these are scored"
    yield from (f"the true path {doubt}" for doubt in path_doubts(truth.poses, recording))
    if truth.landmarks is None or truth.landmark_ids is None or recording.landmark is None:
        return
    model, place_of = SENSORS[recording.sensor], dict(zip(truth.landmark_ids.tolist(), truth.landmarks, strict=True))
    places = np.array([place_of.get(name, (np.nan, np.nan)) for name in recording.landmark.tolist()]).reshape(-1, 2)
    seen = predict(model.name, in_body(truth.poses[recording.observation_step], places))
    sigmas = np.sqrt(np.diagonal(recording.observation_cov, axis1=1, axis2=2))
    ratios = np.abs(innovation(model.name, recording.observation, seen)) / sigmas
    ratios = ratios[np.isfinite(ratios).all(axis=1)]
    for name, ratio in zip(model.columns, np.median(ratios, axis=0) / MEDIAN if len(ratios) else (), strict=False):
        if ratio > NOISE:
            what = f"the residuals of {name} with the true path and map are {ratio:.2g} times its stated noise"
            yield f"{what}; check ids, units, axes and stamps of the truth"


def path_doubts(poses: Float, recording: Recording) -> Iterator[str]:
    """Yield what the motions along a path contradict, as ends of sentences that begin with the name of the path.

    The ratio is the least-squares slope of the motions in the body frame over the odometry: 1 apart from errors, 0.001
    for metres read as millimetres, 57 for degrees, -1 for clockwise angles. Poses (N+1, 3) that are NaN are not used.
    """
    start = np.abs(between(recording.prior_mean, poses[0]))
    if (start > START + 6.0 * np.sqrt(np.diag(recording.prior_cov).max())).any():
        x, y, heading = poses[0]
        yield f"starts at ({x:.4g} m, {y:.4g} m, {heading:.3g} rad), far from the prior; check its frame and headings"
    if late := _late(poses, recording):
        when = "after" if late > 0.0 else "before"
        yield f"turns {abs(late):g} s {when} the odometry; add {-late:g} s to its stamps (an estimate's: --time-offset)"
        return
    motions = between(poses[:-1], poses[1:])
    known = np.isfinite(motions).all(axis=1)
    variances = np.diagonal(recording.odometry_cov, axis1=1, axis2=2)
    for what, columns, remedy in (
        ("distances", [0, 1], "check the unit of lengths, the directions of the axes and the stamps"),
        ("turns", [2], "check the unit and the sign of headings, and the stamps"),
    ):
        odometry, path = recording.odometry[known][:, columns], motions[known][:, columns]
        product, squares, of_path = (float(np.sum(each)) for each in (odometry * path, odometry**2, path**2))
        is_signal = squares > SIGNAL * float(np.sum(variances[known][:, columns]))
        is_same = len(path) > FEW and product**2 > CORRELATED * squares * of_path
        ratio = product / (squares or 1.0)
        if (is_signal or is_same) and not 1.0 / MOST <= ratio <= MOST:
            yield f"has {ratio:.3g} times the {what} of the odometry; {remedy}"


def _late(poses: Float, recording: Recording) -> float:
    """Return by how much a path turns later than the odometry [s]; 0 if no offset makes turns agree that disagree.

    Turns in a second are compared. The offset must be clearly better than none, and than turns of the opposite sign.
    """
    known, stamps = np.isfinite(poses).all(axis=1), recording.stamps
    times = np.arange(stamps[0] - LATE[0], stamps[-1] - LATE[-1])
    if len(times) < FEW or not known.any():
        return 0.0
    headings = np.unwrap(poses[known, 2])
    turns = np.diff(np.interp(times, stamps, np.append(0.0, np.cumsum(recording.odometry[:, 2]))))

    def difference(late: float, sign: float = 1.0) -> float:
        found = np.diff(np.interp(times + late, stamps[known], headings))
        return float(np.mean((sign * found - turns) ** 2))

    best = min(LATE.tolist(), key=difference)
    without = min(difference(0.0), difference(0.0, sign=-1.0))
    return best if without > max(CLEARLY * difference(best), TURNING**2) else 0.0


class Mistake(NamedTuple):
    """A mistake as a sentence about the log, and what undoes it.

    `late` is added to the stamps of observations [s]. The factor `bearing` -1 also mirrors positions in the body frame,
    `length` is for observed lengths, `turn` and `way` are for the odometry. `rates` is whether the turns come from yaw
    rates, so that the distances are chords of arcs.
    """

    what: str
    late: float = 0.0
    bearing: float = 1.0
    length: float = 1.0
    turn: float = 1.0
    way: float = 1.0
    rates: bool = False

    def undone(self, recording: Recording) -> Recording:
        """Return a recording without the mistake; observations beyond its time are left out."""
        stamps, of_column = recording.stamps, dict.fromkeys(("range", "x", "y"), self.length)
        of_column |= {"y": self.length * np.sign(self.bearing), "bearing": self.bearing}
        factors = np.array([of_column[name] for name in SENSORS[recording.sensor].columns])
        ways = np.array([self.way, self.way, self.turn])
        odometry = exp(log(recording.odometry) * ways) if self.rates else recording.odometry * ways
        at = stamps[recording.observation_step] + self.late
        inside = (at >= stamps[0]) & (at <= stamps[-1])
        steps = np.rint(np.interp(at[inside], stamps, np.arange(len(stamps)))).astype(np.int64)
        changed = replace(recording, odometry=odometry, observation=recording.observation * factors)
        return replace(changed.only(inside), observation_step=steps)


OFFSETS = tuple(
    Mistake(f"their stamps are {abs(each):g} s {'late' if each < 0.0 else 'early'}", late=each)
    for each in 0.5 * np.arange(-10, 11)
    if each
)
MISTAKES = (
    Mistake("observations and odometry count angles in opposite directions", bearing=-1.0),
    Mistake("bearings are in degrees, read as radians", bearing=DEGREE),
    Mistake("turns are in degrees, read as radians", turn=DEGREE),
    Mistake("yaw rates are in deg/s, read as rad/s", turn=DEGREE, rates=True),
    Mistake("bearings and turns are in degrees, read as radians", bearing=DEGREE, turn=DEGREE),
    Mistake("bearings are in radians, read as degrees", bearing=1 / DEGREE),
    Mistake("turns are in radians, read as degrees", turn=1 / DEGREE),
    Mistake("bearings and turns are in radians, read as degrees", bearing=1 / DEGREE, turn=1 / DEGREE),
    *(
        Mistake(f"{what} are {factor:g} times too {size}", length=undone**length, turn=undone**turn, way=undone**way)
        for what, (length, turn, way) in {
            "observed lengths": (1, 0, 0),
            "distances of the odometry": (0, 0, 1),
            "all lengths": (1, 0, 1),
            "turns and distances of the odometry": (0, 1, 1),
        }.items()
        for factor in (1000, 100)
        for size, undone in (("large", 1 / factor), ("small", float(factor)))
    ),
)


class Fit(NamedTuple):
    """Share of observations that agree; median and mean of NIS / dof; deviation of the mean from 1, in its sigmas."""

    share: float
    nis: float
    mean: float
    deviation: float


NO_ESTIMATE, NOTHING_SEEN_TWICE = Fit(0.0, 0.0, 0.0, 0.0), Fit(1.0, 0.0, 1.0, 0.0)


def agreement(recording: Recording) -> tuple[float, str]:
    """Return the share of observations that agree with one place per landmark, and a doubt; "" without one.

    A mistake of units or signs is a UserError.
    """
    is_bearing = recording.sensor == "bearing"
    if SENSORS[recording.sensor].has_range:
        recording = recording.only(recording.observation[:, 0] > 0.0)  # sensors write 0 where they detect nothing
    fit = _fit(recording)
    if len(recording.observation) < FEW:
        return fit.share, ""
    if fit is NOTHING_SEEN_TWICE:
        return fit.share, "no landmark is observed at two steps: nothing corrects the path; check the ids"
    if fit.share < DOUBTED:
        if offset := _found(OFFSETS, recording):
            return fit.share, f"{fit.share:.1%} {PLACE}, but {offset}"
        if mistake := _found(MISTAKES, recording):
            raise UserError(f"{fit.share:.1%} {PLACE}, but {mistake}")
    if fit.share < (POOR_BEARINGS if is_bearing else CONVINCING):
        remedy = "check units, signs, stamps and ids, and the noise (`slamgauge noise`)"
        return fit.share, f"only {fit.share:.1%} {PLACE}; {remedy}"
    if not is_bearing and abs(fit.deviation) > DIFFERS and abs(fit.mean - 1.0) > FACTOR:
        what = f"the measurements do not fit their stated noise (the mean NIS / dof is {fit.mean:.2g} instead of 1)"
        return fit.share, f"{what}: `slamgauge noise RECORDING` finds the noise that they support"
    return fit.share, ""


def _fit(recording: Recording) -> Fit:
    """Return how well the filter fits observations that do not add landmarks."""
    with redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
        try:
            estimate = riekf(recording)
        except UserError:
            return NO_ESTIMATE
    nis, dof = estimate.nis, estimate.nis_dof
    if nis is None or dof is None or not dof.any():
        return NOTHING_SEEN_TWICE
    counts = np.bincount(recording.observation_step, minlength=recording.steps + 1)[dof > 0]
    nis, dof = nis[dof > 0], dof[dof > 0]
    share = float(np.average(nis < chi2.ppf(BOUND, dof), weights=counts))
    mean = float(nis.sum() / dof.sum())
    return Fit(share, float(np.median(nis / dof)), mean, (mean - 1.0) * float(np.sqrt(dof.sum() / 2.0)))


def _found(mistakes: Sequence[Mistake], recording: Recording) -> str:
    """Return the mistake without which the observations agree, with its remedy; "" without one."""
    fits, model = dict[Mistake, Fit](), SENSORS[recording.sensor]
    for each in mistakes:
        undone = each.undone(recording)
        sigmas = np.sqrt(np.diagonal(undone.observation_cov, axis1=1, axis2=2))
        lengths = (np.abs(undone.observation) / sigmas)[:, ~np.array(model.is_angle)]
        are_resolved = not lengths.size or np.median(lengths) >= RESOLVED  # with smaller ones most paths agree
        if are_resolved and len(lengths) > INSIDE * len(recording.observation):
            fits[each] = _fit(undone)

    def evidence(each: Mistake) -> tuple[float, float, float]:  # small numbers agree with everything
        size = abs(each.bearing) * each.length * each.turn * each.way
        return round(size, 9), fits[each].share, -fits[each].mean

    found = [each for each, fit in fits.items() if fit.share > CONVINCING and fit.nis > SMALL]
    best = max(found, key=evidence, default=None)
    if best is None:
        return ""
    remedy = "correct the unit (in recording.toml: angle, length, time)"
    if best.bearing < 0.0 or best.late:
        remedy = "give both files the same clock" if best.late else "change the sign of those that are clockwise"
    return f"{fits[best].share:.1%} if {best.what}; {remedy}"
