"""Data of the replay of a run, encoded for its page; `replay.js` uses the same names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, distinct
from slamgauge.compare.figures.maps import MapRows, first_seen, map_at
from slamgauge.compare.figures.run_figures import Reference, reference_of, run_limits
from slamgauge.compare.report.page import Look, pack
from slamgauge.compare.scoring.catalogue import Measured
from slamgauge.compare.scoring.consistency import chi2_band, distances, pose_errors, squared_mahalanobis
from slamgauge.compare.scoring.run_arrays import closure_steps, pose_covs_of
from slamgauge.compare.storage.files import Results
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose
from slamgauge.sensors import SENSORS, inverse
from slamgauge.truth import Truth

MOST_FRAMES = 1500  # more than the pixel columns of a panel
FEWEST_FRAMES = 30
STEP_LEVEL = 0.95  # level of the band of the NEES of single steps
FULL_WEIGHT = 255  # byte for weight 1


class ShownObservations(NamedTuple):
    """The observations that a replay shows, frame by frame."""

    observation: Int  # (m,) row numbers in the recording
    start: Int  # (T+1,) first entry of each frame in the other arrays
    body: Float  # (m, 2) positions in the body frame [m]; for a bearing a point in its direction


def replay_data(results: Results, looks: Sequence[Look], room: int) -> dict[str, Any]:
    """Return the data of a run with as many frames as `room` allows.

    `room` is the largest number of JSON characters; it may be exceeded with `FEWEST_FRAMES` frames.
    """
    count = MOST_FRAMES
    while True:
        data = _data(results, looks, frame_steps(results.recording.steps, count))
        if len(json.dumps(data)) <= room or count <= FEWEST_FRAMES:
            return data
        count = max(count * 3 // 4, FEWEST_FRAMES)


def _data(results: Results, looks: Sequence[Look], shown: Int) -> dict[str, Any]:
    recording, truth = results.recording, results.truth or Truth()
    low, high = run_limits(truth, recording, results.estimates)
    observations = shown_observations(recording, shown, float((high - low).max()))
    reference = reference_of(truth, recording, results.estimates)
    closures = closure_steps(truth, recording)
    closure_frames = [] if closures is None else np.unique(np.searchsorted(shown, closures))
    named = "error" if reference.name is None else f"difference to {reference.name}"
    return {
        "step": pack(shown, "i4"),
        "time": pack(recording.stamps[shown] - recording.stamps[0]),
        "truth": {
            "poses": None if truth.poses is None else pack(truth.poses[shown]),
            "landmarks": None if truth.landmarks is None else pack(truth.landmarks),
        },
        "observations": {
            "start": pack(observations.start, "i4"),
            "body": pack(observations.body),
            "bearingOnly": not SENSORS[recording.sensor].places_landmarks,
        },
        "estimates": [_estimate(results, look, reference, observations, shown) for look in looks],
        "closures": pack(closure_frames, "i4"),
        "world": {"low": low.tolist(), "high": high.tolist()},
        "errorTitle": f"position {named} [m]",
        "neesBand": list(chi2_band(STEP_LEVEL, 3)),
    }


def _estimate(
    results: Results, look: Look, reference: Reference, observations: ShownObservations, shown: Int
) -> dict[str, Any]:
    recording, estimate = results.recording, results.estimates[look.name]
    errors = pose_errors(reference.poses[shown], estimate.poses[shown])
    covs = pose_covs_of(estimate)[shown]
    nees = squared_mahalanobis(errors, covs) if reference.name is None else np.full(len(shown), np.nan)
    wrong = Measured(results.truth or Truth(), recording, estimate).wrong
    wrong_steps = [] if wrong is None else recording.observation_step[wrong]
    given = recording.landmark if estimate.association is None else estimate.association
    rows = observations.observation
    nis = np.full(len(estimate.poses), np.nan)
    if estimate.nis is not None and estimate.nis_dof is not None:
        nis = np.divide(estimate.nis, estimate.nis_dof, out=nis, where=estimate.nis_dof > 0)
    return {
        "name": look.name,
        "color": look.color,
        "dashes": list(look.dashes),
        "shown": look.shown,
        "poses": pack(estimate.poses[shown]),
        "predicted": pack(_predicted(recording, estimate, shown)),
        "covs": None if estimate.pose_covs is None else pack(triangle(covs)),
        "error": pack(distances(errors)),
        "nees": pack(nees),
        "nis": pack(nis[shown]),
        "rows": packed_map(recording, estimate, shown),
        "association": None if given is None else pack(given[rows], "i4"),
        "wrong": None if wrong is None else pack(wrong[rows], "u1"),
        "wrongFrames": pack(distinct(np.searchsorted(shown, wrong_steps)), "i4"),
    }


def _predicted(recording: Recording, estimate: Estimate, shown: Int) -> Float:
    """Return the predicted poses (T, 3) before the update; for smoothed estimates their own poses."""
    if estimate.kind == "smoothed":
        return estimate.poses[shown]
    before = shown[shown > 0] - 1
    moved = compose(estimate.poses[before], recording.odometry[before])
    start = np.repeat(recording.prior_mean[None], len(shown) - len(before), axis=0)
    return np.concatenate([start, moved])


def frame_steps(steps: int, count: int) -> Int:
    """Return at most `count` of the steps 0..`steps`, evenly spaced, including both ends."""
    evenly = np.linspace(0, steps, min(count, steps + 1))
    return np.unique(evenly.round().astype(np.int64))


def shown_observations(recording: Recording, shown: Int, length: float) -> ShownObservations:
    """Return the last scan since the previous shown step, for each shown step; bearings get the `length` [m]."""
    steps = recording.observation_step
    before = np.concatenate([[-1], shown[:-1]])
    begins = np.searchsorted(steps, before, side="right")
    ends = np.searchsorted(steps, shown, side="right")
    last_steps = steps[np.maximum(ends - 1, 0)] if len(steps) else ends
    begins = np.maximum(begins, np.searchsorted(steps, last_steps))
    counts = np.where(ends > begins, ends - begins, 0)
    start = np.concatenate([[0], np.cumsum(counts)])
    place_in_frame = np.arange(start[-1]) - np.repeat(start[:-1], counts)
    observation = np.repeat(begins, counts) + place_in_frame
    body = inverse(recording.sensor, recording.observation[observation])
    if not SENSORS[recording.sensor].places_landmarks:
        body = length * body
    return ShownObservations(observation, start, body)


def packed_map(recording: Recording, estimate: Estimate, shown: Int) -> dict[str, Any] | None:
    """Return the map of each shown step, or the final map with the frame of each first observation; None without a map.

    A recorded map is stored for each frame with a new record since the previous frame.
    """
    history, log, count = estimate.history, estimate.rays, len(estimate.landmark_ids)
    since = None
    if history is not None and len(history.step):
        changes = np.searchsorted(history.step, shown, side="right")
        if log is not None:  # lost rays leave the map between two records
            lost = np.sort(log.end[log.end >= 0])
            changes = changes + np.searchsorted(lost, shown, side="right")
        frames = np.flatnonzero(np.diff(changes, prepend=0) > 0)
        maps = [map_at(estimate, int(step)) for step in shown[frames]]
        covs = np.concatenate([np.zeros((0, 2, 2)), *(each.cov for each in maps)])
    elif count:
        frames = np.zeros(1, np.int64)
        covs = estimate.landmark_covs
        known = np.zeros((count, 2, 2)) if covs is None else covs
        maps = [MapRows(estimate.landmark_ids, np.full(count, -1), np.ones(count), estimate.landmarks, known)]
        since = pack(np.searchsorted(shown, first_seen(recording, estimate)), "i4")
    else:
        return None
    sizes = [len(each.landmark) for each in maps]
    return {
        "mapAt": pack(np.searchsorted(frames, np.arange(len(shown)), side="right") - 1, "i4"),
        "start": pack(np.cumsum([0, *sizes]), "i4"),
        "landmark": pack(np.concatenate([each.landmark for each in maps]), "i4"),
        "member": pack(np.concatenate([each.member for each in maps]) + 1, "u1"),
        "weight": pack(np.concatenate([each.weight for each in maps]) * FULL_WEIGHT, "u1"),
        "place": pack(np.concatenate([each.position for each in maps])),
        "cov": None if covs is None else pack(triangle(covs)),
        "since": since,
        "isHistory": since is None,
    }


def triangle(covs: Float) -> Float:
    """Return xx, xy, yy (n, 3) of covariances (n, 2, 2) or larger."""
    return np.column_stack([covs[:, 0, 0], covs[:, 0, 1], covs[:, 1, 1]])
