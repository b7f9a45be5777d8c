"""The ROS 2 example with stubs of ROS: it gives the poses of the filter that it drives."""

from __future__ import annotations

import importlib.util
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamgauge.ekf import riekf
from tests.reference.bags import Bags, detection, odometry_messages, scan_messages
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow

NODE = Path(__file__).parents[1] / "examples/ros2_node.py"


class Message:
    """A message whose fields exist when they are used."""

    SPHERE_LIST = 7

    def __init__(self, **given: Any) -> None:
        self.__dict__.update(given)

    def __getattr__(self, name: str) -> Message:
        self.__dict__[name] = Message()
        return self.__dict__[name]


class StubNode:
    """Stores what a node publishes, and the functions of its subscriptions."""

    def __init__(self, _name: str) -> None:
        self.published: dict[str, list[Any]] = defaultdict(list)
        self.subscriptions_: dict[str, Callable[[Any], None]] = {}

    def create_publisher(self, _kind: type, topic: str, _depth: int) -> SimpleNamespace:
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, _kind: type, topic: str, function: Callable[[Any], None], _depth: int) -> None:
        self.subscriptions_[topic] = function


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    names = {
        "rclpy": {},
        "rclpy.node": {"Node": StubNode},
        "geometry_msgs.msg": {"Point": Message, "PoseWithCovarianceStamped": Message},
        "nav_msgs.msg": {"Odometry": Message},
        "vision_msgs.msg": {"Detection3DArray": Message},
        "visualization_msgs.msg": {"Marker": Message},
    }
    for name, content in names.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], module)
    spec = importlib.util.spec_from_file_location("ros2_node", NODE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SlamNode()


def test_the_node_gives_the_poses_of_its_filter(node: Any):
    _, drawn = random_recording(4, sensor="position", prior_sigmas=(0.0, 0.0, 0.0))
    recording = drawn.only(drawn.observation_step > 0)
    bags = Bags("mcap")
    scans = scan_messages(recording, "/detections", "vision_msgs/msg/Detection3DArray", detection, "detections")
    for topic, _, kind, fields in sorted([*odometry_messages(recording), *scans], key=lambda message: message[1]):
        node.subscriptions_[topic](bags.made(kind, fields))
    expected = riekf(recording)
    assert expected.pose_covs is not None
    last = node.published["/slam/pose"][-1]
    step = int(recording.observation_step[-1])
    turn = recording.prior_mean[2]  # the node starts at the origin
    c, s = np.cos(turn), np.sin(turn)
    x, y = (expected.poses[step, :2] - recording.prior_mean[:2]) @ np.array([[c, -s], [s, c]])
    assert_allclose([last.pose.pose.position.x, last.pose.pose.position.y], [x, y], atol=1e-6)
    heading = 2.0 * np.arctan2(last.pose.pose.orientation.z, last.pose.pose.orientation.w)
    assert_allclose(np.cos(heading - expected.poses[step, 2] + turn), 1.0, atol=1e-9)
    assert_allclose(np.reshape(last.pose.covariance, (6, 6))[5, 5], expected.pose_covs[step, 2, 2], rtol=1e-3)
    assert len(node.published["/slam/landmarks"][-1].points) == len(expected.landmark_ids)


def test_the_node_accepts_a_scan_without_detections(node: Any):
    node.subscriptions_["/detections"](Message(header=Message(), detections=[]))
    assert node.published["/slam/landmarks"][-1].points == []
