"""Doubts about an imported log or a path: units, signs, ids and noise that the log's own measurements contradict.

Where observations have ids, a quick filter pass over the beginning of a log finds mistakes (see `log_mistakes`): a log
with a mistake of units or signs is refused. All other doubts are warnings.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Imported, of_file
from slamgauge.compare.datasets.log_mistakes import agreement
from slamgauge.recording import Recording
from slamgauge.se2 import between, in_body
from slamgauge.sensors import SENSORS, innovation, predict
from slamgauge.truth import Truth

PASS = 2000  # observations of a quick pass
NOISE = 20.0  # factor between residuals and stated noise
FASTEST, QUICKEST, LONGEST = 50.0, 2.0 * np.pi, 10.0  # m/s, rad/s, s: typical speed and step, large yaw rate
COVERED = 0.5  # share of the steps with a true pose, below which a warning is printed
MEDIAN = 0.6745  # median of the absolute value of a standard normal number
MOST = 2.0  # largest ratio, or inverse ratio, of motions that are the same but for errors
START = np.array([1.0, 1.0, 0.5])  # m, m, rad: a start that is farther from the prior's mean than this and 6 sigmas
SHIFTS, CLEARLY, TURNING = 6, 4.0, 0.02  # delays that are tried; ratio of mean squares; rad that make a delay visible
SIGNAL = 4.0  # smallest ratio of the odometry's squares to its variances; below it the odometry is mostly noise


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
        "observations": f"{count} within the steps, {log.unmatched} outside",
        "doubled observations": str(doubled),
    }
    doubts = [*_of_motion(recording)]
    if doubled:
        same = "the step, landmark and values of another one"
        doubts.append(f"{doubled} observations have {same} and count twice; remove them")
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
    distance, sigma = np.quantile(ways, 0.9), np.median(np.sqrt(recording.odometry_cov[:, 0, 0]))
    if sigma > NOISE * distance > 0.0:
        what = f"the typical standard deviation of a step is {sigma:.3g} m, and its distance {distance:.3g} m"
        yield f"{what}; correct the noise (variance, standard deviation or information?)"
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
    for metres read as millimetres, 57 for degrees, -1 for clockwise angles.

    Args:
        poses: (N+1, 3) x, y [m], heading [rad]; rows of NaN are not used.
        recording: its odometry is the reference.
    """
    start = np.abs(between(recording.prior_mean, poses[0]))
    if (start > START + 6.0 * np.sqrt(np.diag(recording.prior_cov).max())).any():
        x, y, heading = poses[0]
        yield f"starts at ({x:.4g} m, {y:.4g} m, {heading:.3g} rad), far from the prior; check its frame and headings"
    motions = between(poses[:-1], poses[1:])
    known = np.isfinite(motions).all(axis=1)
    variances = np.diagonal(recording.odometry_cov, axis1=1, axis2=2)
    agrees = True
    for what, columns, remedy in (
        ("distances", [0, 1], "check the unit of lengths, the directions of the axes and the stamps"),
        ("turns", [2], "check the unit and the sign of headings, and the stamps"),
    ):
        odometry = recording.odometry[known][:, columns]
        squares = float(np.sum(odometry**2))
        ratio = float(np.sum(odometry * motions[known][:, columns])) / (squares or 1.0)
        if squares > SIGNAL * float(np.sum(variances[known][:, columns])) and not 1.0 / MOST <= ratio <= MOST:
            yield f"has {ratio:.3g} times the {what} of the odometry; {remedy}"
            agrees = False
    late = _delay(poses, recording) if agrees and known.any() else 0.0
    if late:
        yield f"turns {abs(late):.3g} s {'after' if late > 0.0 else 'before'} the odometry; check its stamps"


def _delay(poses: Float, recording: Recording) -> float:
    """Return the time [s] by which the turns along a path are later than those of the odometry; 0 if that is not clear.

    Turns in a second are compared at delays of up to `SHIFTS` half seconds; steps that take longer have longer delays.
    """
    known, stamps = np.isfinite(poses).all(axis=1), recording.stamps
    window = max(1.0, 2.0 * float(np.median(np.diff(stamps))))
    shifts = 0.5 * window * np.arange(-SHIFTS, SHIFTS + 1)
    times = np.arange(stamps[0] - shifts[0], stamps[-1] - shifts[-1] - window, 0.5 * window)
    if len(times) < 4 * SHIFTS:
        return 0.0
    driven, path = np.append(0.0, np.cumsum(recording.odometry[:, 2])), np.unwrap(poses[known, 2])
    turns = np.interp(times + window, stamps, driven) - np.interp(times, stamps, driven)
    found = list[float]()
    for shift in shifts:
        begin, end = np.interp([times + shift, times + shift + window], stamps[known], path)
        found.append(float(np.mean((end - begin - turns) ** 2)))
    best = int(np.argmin(found))
    is_clear = found[SHIFTS] > CLEARLY * found[best] and found[SHIFTS] > TURNING**2
    return float(shifts[best]) if is_clear else 0.0
