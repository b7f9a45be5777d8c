"""Bags as robots write them: rates, several cameras, compression, missing metadata, missing stamps, no messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamgauge.compare.datasets.bag_log import read_bag
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation
from tests.reference.bags import (
    KINDS,
    Bags,
    Message,
    detection,
    header,
    in_order,
    odometry_messages,
    scan_messages,
    xyz,
    yaw,
)
from tests.reference.random_recordings import random_recording


def simulated(steps: int = 40) -> Recording:
    """Return a recording with positions of landmarks and a start at the origin without uncertainty."""
    _, drawn = random_recording(3, sensor="position", steps=steps, prior_sigmas=(0.0, 0.0, 0.0))
    return replace(drawn, prior_mean=np.zeros(3), stamps=1000.0 + drawn.stamps)


def detections(recording: Recording, topic: str = "/detections") -> list[Message]:
    return scan_messages(recording, topic, "vision_msgs/msg/Detection3DArray", detection, "detections")


@pytest.mark.parametrize("kind", KINDS)
def test_compressed_bags(kind: str, tmp_path: Path):
    recording = simulated()
    messages = in_order(odometry_messages(recording), detections(recording))
    found = read_bag(Bags(kind, compressed=True).write(tmp_path / "run", messages)).recording
    assert_allclose(found.observation, recording.observation, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_messages_is_one_line(kind: str, tmp_path: Path):
    path = Bags(kind).write(tmp_path / "run", [])
    with pytest.raises(UserError, match=r"run.*topic") as caught:
        read_bag(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_folder_without_metadata_is_one_line(kind: str, tmp_path: Path):
    recording = simulated()
    path = Bags(kind).write(tmp_path / "run", in_order(odometry_messages(recording), detections(recording)))
    (path / "metadata.yaml").unlink()
    with pytest.raises(UserError, match=r"run: has no metadata\.yaml, so it is no ROS 2 bag; give its \.mcap"):
        read_bag(path)
    (file,) = path.iterdir()
    assert_allclose(read_bag(file).recording.observation, recording.observation, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_without_stamps_in_headers_the_times_of_recording_are_used(kind: str, tmp_path: Path):
    recording = simulated()
    messages = in_order(odometry_messages(recording), detections(recording))
    for *_, fields in messages:
        fields["header"] = header(0.0, fields["header"]["frame_id"])
    path = Bags(kind).write(tmp_path / "run", messages)
    found = read_bag(path)
    assert "/odom: no stamps in its headers; times of recording are used" in " ".join(found.notes)
    assert_allclose(found.recording.stamps, recording.stamps, atol=1e-6)
    assert_allclose(found.recording.observation, recording.observation, atol=1e-9)


def test_odometry_at_100_hz_and_detections_at_5_hz(tmp_path: Path):
    """Each detection is between two odometry messages, which then has another step."""
    drawn = simulated(400)
    recording = replace(drawn, stamps=np.linspace(1000.0, 1004.0, 401)).only(drawn.observation_step % 20 == 10)
    seen = detections(recording)
    for *_, fields in seen:
        stamp = fields["header"]["stamp"]
        stamp["nanosec"] += 3_000_000  # 3 ms after the step
    found = read_bag(Bags("mcap").write(tmp_path / "run", in_order(odometry_messages(recording), seen))).recording
    assert found.steps == 400 + len(seen)
    seconds = found.stamps[found.observation_step] - recording.stamps[recording.observation_step]
    assert_allclose(seconds, 0.003, atol=1e-6)
    path = chain(np.zeros(3), recording.odometry)
    assert_allclose(chain(np.zeros(3), found.odometry)[-1], path[-1], atol=1e-9)


def test_two_cameras_with_static_transforms(tmp_path: Path):
    """Detections of two cameras, each in its own frame, are those of one sensor at the base."""
    recording = simulated()
    mounts = {"left": (0.2, 0.1, 0.5), "right": (0.2, -0.1, -0.5)}
    is_left = recording.observation[:, 1] > 0.0
    messages = [odometry_messages(recording)]
    for (frame, (x, y, heading)), rows in zip(mounts.items(), (is_left, ~is_left), strict=True):
        part = recording.only(rows)
        turn = rotation(np.array(heading))
        mounted = replace(
            part,
            observation=(part.observation - [x, y]) @ turn,
            observation_cov=turn.T @ part.observation_cov @ turn,
        )
        messages.append(detections(mounted))
        for *_, fields in messages[-1]:
            fields["header"]["frame_id"] = frame
    transforms = [
        {
            "header": header(1000.0, "base_link"),
            "child_frame_id": frame,
            "transform": {"translation": xyz(x, y), "rotation": yaw(heading)},
        }
        for frame, (x, y, heading) in mounts.items()
    ]
    static = ("/tf_static", 1_000_000_000_000, "tf2_msgs/msg/TFMessage", {"transforms": transforms})
    found = read_bag(Bags("mcap").write(tmp_path / "run", in_order([static], *messages))).recording
    assert found.landmark is not None
    assert recording.landmark is not None
    mine = np.lexsort((recording.landmark, recording.observation_step))
    theirs = np.lexsort((found.landmark, found.observation_step))
    assert_allclose(found.observation[theirs], recording.observation[mine], atol=1e-9)
    assert_allclose(found.observation_cov[theirs], recording.observation_cov[mine], atol=1e-9)
