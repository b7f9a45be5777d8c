"""Doubts about an imported log: units, signs, ids and noise that its own measurements contradict.

Where observations have ids, a quick filter pass over the beginning of a log finds mistakes (see `log_mistakes`): a log
with a mistake of units or signs is refused. All other doubts are warnings.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.imported_log import Imported, of_file
from slamgauge.compare.datasets.log_mistakes import clock_offset, quick_fit, refuse_mistakes
from slamgauge.compare.datasets.path_doubts import path_doubts
from slamgauge.recording import Recording
from slamgauge.se2 import in_body
from slamgauge.sensors import SENSORS, innovation, predict
from slamgauge.truth import Truth

FEW, PASS = 20, 2000  # observations: fewer show no doubts; observations of a quick pass
POOR = 0.9  # share of observations that agree, below which a log without a known mistake is warned of
POOR_BEARINGS = 0.5  # the same for bearing-only landmarks, with which the filter of the pass is itself inconsistent
DIFFERS, FACTOR = 3.0, 0.1  # deviation of the mean NIS in its standard deviations, and from 1: the noise does not fit
NOISE = 20.0  # factor between residuals and stated noise
FASTEST, QUICKEST, LONGEST = 50.0, 2.0 * np.pi, 10.0  # m/s, rad/s, s: typical speed and step, large yaw rate
FARTHEST = 1e9  # m from the origin
COVERED = 0.5  # share of the steps with a true pose, below which a warning is printed
MEDIAN = 0.6745  # median of the absolute value of a standard normal number


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
        count = len(recording.observation)
        beginning = recording.first(int(recording.observation_step[PASS])) if count > PASS else recording
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
    known = int(np.sum(np.isfinite(truth.poses[:, :2]).all(axis=1)))
    if known < COVERED * len(truth.poses):
        yield f"the true path has poses at {known} of {len(truth.poses)} steps; only these are scored"
    yield from (f"the true path {doubt}" for doubt in path_doubts(truth.poses, recording))
    if truth.landmarks is None or truth.landmark_ids is None:
        return
    for name, ratio in _residuals(recording, truth.poses, truth.landmark_ids, truth.landmarks).items():
        if ratio > NOISE:
            what = f"the residuals of {name} with the true path and map are {ratio:.2g} times its stated noise"
            yield f"{what}; check ids, units, axes and stamps of the truth"


def _agreement(recording: Recording) -> tuple[float, list[str]]:
    """Return the share of observations that agree with one place per landmark, and doubts.

    Raises:
        UserError: they agree once a mistake is undone.
    """
    recording = _without_zero_ranges(recording)
    fit, estimate = quick_fit(recording)
    if len(recording.observation) < FEW:
        return fit.share, []
    if estimate is not None and estimate.nis_dof is not None and not estimate.nis_dof.any():
        return fit.share, ["no landmark is observed at two steps: nothing corrects the path; check the ids"]
    offset = clock_offset(recording, fit)
    if offset:
        return fit.share, [offset]
    refuse_mistakes(recording, fit)
    has_range = SENSORS[recording.sensor].name != "bearing"
    if fit.share < (POOR if has_range else POOR_BEARINGS):
        what = f"only {fit.share:.1%} of the observations agree with one place per landmark"
        return fit.share, [f"{what}; check units, signs, stamps and ids, and the noise (`slamgauge noise`)"]
    if has_range and abs(fit.deviation) > DIFFERS and abs(fit.mean - 1.0) > FACTOR:
        what = f"the measurements do not fit their stated noise (the mean NIS / dof is {fit.mean:.2g} instead of 1)"
        return fit.share, [f"{what}: `slamgauge noise RECORDING` finds the noise that they support"]
    return fit.share, []


def _without_zero_ranges(recording: Recording) -> Recording:
    """Return the recording without observations of range 0, which sensors write where they detect nothing."""
    return recording.only(recording.observation[:, 0] > 0.0) if SENSORS[recording.sensor].has_range else recording


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
    seen = predict(model.name, in_body(seen_from[rows], landmarks[at[rows]]))
    residuals = innovation(model.name, recording.observation[rows], seen)
    sigmas = np.sqrt(np.diagonal(recording.observation_cov[rows], axis1=1, axis2=2))
    return dict(zip(model.columns, np.median(np.abs(residuals) / sigmas, axis=0) / MEDIAN, strict=True))
