"""Which steps a replay shows, and what was seen at them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.recording import Recording
from slamgauge.sensors import SENSORS, inverse


class Sights(NamedTuple):
    """The observations that a replay shows.

    Attributes:
        observation: (m,) their numbers in the recording, frame by frame.
        start: (T+1,) where those of each frame begin.
        body: (m, 2) where they put the landmark, in the robot's frame [m]; of bearings alone a point of that direction.
    """

    observation: Int
    start: Int
    body: Float


def frame_steps(steps: int, count: int) -> Int:
    """At most `count` of the steps 0..`steps`, evenly spaced, both ends among them."""
    return np.unique(np.linspace(0, steps, min(count, steps + 1)).round().astype(np.int64))


def sights_of(recording: Recording, shown: Int, length: float) -> Sights:
    """The last scan up to each of the steps that are shown; bearings alone are drawn `length` [m] long."""
    before = np.concatenate([[-1], shown[:-1]])
    ends = np.searchsorted(recording.observation_step, shown, side="right")
    begins = np.searchsorted(recording.observation_step, before, side="right")
    last = recording.observation_step[np.maximum(ends - 1, 0)] if len(recording.observation_step) else ends
    begins = np.maximum(begins, np.searchsorted(recording.observation_step, last))
    counts = np.where(ends > begins, ends - begins, 0)
    start = np.concatenate([[0], np.cumsum(counts)])
    observation = np.repeat(begins, counts) + np.arange(start[-1]) - np.repeat(start[:-1], counts)
    return Sights(observation, start, _in_the_body(recording, observation, length))


def _in_the_body(recording: Recording, observation: Int, length: float) -> Float:
    delta = inverse(recording.sensor, recording.observation[observation])
    return delta if SENSORS[recording.sensor].places_landmarks else length * delta
