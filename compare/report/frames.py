"""Steps of a replay, and the observations at each of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS, inverse


class ShownObservations(NamedTuple):
    """The observations that a replay shows.

    Attributes:
        observation: Row numbers (m,) in the recording, frame by frame.
        start: First entry (T+1,) of each frame in the other arrays.
        body: Observed positions (m, 2) in the body frame [m]; for a bearing a point in its direction.
    """

    observation: Int
    start: Int
    body: Float


def frame_steps(steps: int, count: int) -> Int:
    """Return at most `count` of the steps 0..`steps`, evenly spaced, including both ends."""
    return np.unique(np.linspace(0, steps, min(count, steps + 1)).round().astype(np.int64))


def shown_observations(recording: Recording, shown: Int, length: float) -> ShownObservations:
    """Return the last scan since the previous shown step, for each shown step; bearings get the `length` [m]."""
    before = np.concatenate([[-1], shown[:-1]])
    ends = np.searchsorted(recording.observation_step, shown, side="right")
    begins = np.searchsorted(recording.observation_step, before, side="right")
    last = recording.observation_step[np.maximum(ends - 1, 0)] if len(recording.observation_step) else ends
    begins = np.maximum(begins, np.searchsorted(recording.observation_step, last))
    counts = np.where(ends > begins, ends - begins, 0)
    start = np.concatenate([[0], np.cumsum(counts)])
    observation = np.repeat(begins, counts) + np.arange(start[-1]) - np.repeat(start[:-1], counts)
    return ShownObservations(observation, start, _in_the_body(recording, observation, length))


def _in_the_body(recording: Recording, observation: Int, length: float) -> Float:
    delta = inverse(recording.sensor, recording.observation[observation])
    return delta if SENSORS[recording.sensor].places_landmarks else length * delta
