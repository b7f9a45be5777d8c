"""ROS bags import to the recording that they were written from, or are refused in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.bag_log import read_bag
from slamgauge.recording import Recording
from tests.reference.bags import (
    KINDS,
    Bags,
    detection,
    in_order,
    odometry_messages,
    own_scan,
    scan_messages,
)
from tests.reference.random_recordings import random_recording

OWN = (
    "observations.topic=/scan",
    "observations.array=landmarks",
    "observations.range=range",
    "observations.bearing=bearing",
    "observations.id=id",
    "observations.covariance=covariance",
)


def simulated(sensor: str = "position", start: float = 1000.0) -> Recording:
    _, recording = random_recording(4, sensor=sensor)
    return replace(recording, stamps=start + recording.stamps, prior_mean=np.zeros(3), prior_cov=np.zeros((3, 3)))


def detections(recording: Recording, topic: str = "/detections"):
    return scan_messages(recording, topic, "vision_msgs/msg/Detection3DArray", detection, "detections")


def assert_same(found: Recording, written: Recording) -> None:
    assert_allclose(found.stamps, written.stamps, rtol=0, atol=1e-6)
    for name in ("odometry", "odometry_cov", "observation", "observation_cov"):
        assert_allclose(getattr(found, name), getattr(written, name), rtol=0, atol=1e-9, err_msg=name)
    assert_array_equal(found.observation_step, written.observation_step)
    assert_array_equal(found.landmark, written.landmark)
    assert found.sensor == written.sensor


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("start", [0.0, 1000.0, 1.7e9])
def test_detections_with_twists(kind: str, start: float, tmp_path: Path):
    recording = simulated(start=start)
    path = Bags(kind).write(tmp_path / "run", in_order(odometry_messages(recording), detections(recording)))
    found = read_bag(path)
    assert_same(found.recording, recording)
    assert found.notes == ()


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_type_of_ones_own_with_poses(kind: str, tmp_path: Path):
    recording = simulated("range-bearing")
    scans = scan_messages(recording, "/scan", "robot_msgs/msg/Scan", own_scan, "landmarks")
    path = Bags(kind).write(tmp_path / "run", in_order(odometry_messages(recording), scans))
    found = read_bag(path, overrides=[*OWN, "odometry.kind=poses"])
    assert_same(found.recording, recording)
