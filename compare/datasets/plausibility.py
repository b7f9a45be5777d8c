"""Doubts about an imported log: units, signs, ids and noise that its own measurements contradict.

Where observations have ids, a quick filter pass over the beginning of a log finds mistakes (see `log_mistakes`): a log
with a mistake of units or signs is refused. All other doubts are warnings.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slamgauge.compare.datasets.imported_log import Imported, of_file
from slamgauge.compare.datasets.log_mistakes import agreement
from slamgauge.compare.datasets.path_doubts import path_doubts
from slamgauge.recording import Recording
from slamgauge.se2 import in_body
from slamgauge.sensors import SENSORS, innovation, predict
from slamgauge.truth import Truth

PASS = 2000  # observations of a quick pass
NOISE = 20.0  # factor between residuals and stated noise
FASTEST, QUICKEST, LONGEST = 50.0, 2.0 * np.pi, 10.0  # m/s, rad/s, s: typical speed and step, large yaw rate
COVERED = 0.5  # share of the steps with a true pose, below which a warning is printed
MEDIAN = 0.6745  # median of the absolute value of a standard normal number


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
