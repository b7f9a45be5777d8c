"""The filter as a ROS 2 node, with `slamgauge` and `rclpy` installed: `python examples/ros2_node.py`.

It subscribes to /odom (nav_msgs/Odometry) and /detections (vision_msgs/Detection3DArray, in the frame of the robot) and
publishes /slam/pose and /slam/landmarks. A detection is used at the latest odometry message before its stamp.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import Marker, MarkerArray

from slamgauge import Observations, SlamFilter
from slamgauge.se2 import exp

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and heading in a covariance of ROS
GATE = 13.8  # squared Mahalanobis distance of two values; true observations exceed it with probability 0.001


class SlamNode(Node):
    """Right-invariant EKF-SLAM with known ids."""

    def __init__(self) -> None:
        super().__init__("slamgauge")
        self.slam = SlamFilter("position", np.zeros(3), np.zeros((3, 3)), "right-invariant")
        self.stamp: float | None = None
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "/slam/pose", 10)
        self.markers = self.create_publisher(MarkerArray, "/slam/landmarks", 10)
        self.create_subscription(Odometry, "/odom", self.predict, 50)
        self.create_subscription(Detection3DArray, "/detections", self.update, 50)

    def predict(self, message: Any) -> None:
        """Move by the twist of an odometry message, which is valid since the last message."""
        stamp, twist = seconds(message.header.stamp), message.twist.twist
        if self.stamp is not None and stamp > self.stamp:
            duration = stamp - self.stamp
            velocity = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
            cov = np.reshape(message.twist.covariance, (6, 6))[PLANAR]
            self.slam.predict(exp(duration * velocity), duration**2 * cov)
        self.stamp = stamp

    def update(self, message: Any) -> None:
        """Correct with the detections of a message, and publish pose and landmarks."""
        found = [(int(each.id), each.results[0].pose) for each in message.detections if each.results]
        if found:
            ids = np.array([name for name, _ in found])
            values = np.array([[each.pose.position.x, each.pose.position.y] for _, each in found])
            covs = np.array([np.reshape(each.covariance, (6, 6))[:2, :2] for _, each in found])
            self.slam.update(Observations(ids, values, covs), gate=GATE)
        self.poses.publish(pose_message(self.slam, message.header.stamp))
        self.markers.publish(MarkerArray(markers=[*marker_messages(self.slam, message.header.stamp)]))


def seconds(stamp: Any) -> float:
    """Return a stamp in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def pose_message(slam: SlamFilter, stamp: Any) -> Any:
    """Return the pose with its covariance in the frame `map`."""
    message, covariance = PoseWithCovarianceStamped(), np.zeros((6, 6))
    message.header.stamp, message.header.frame_id = stamp, "map"
    x, y, heading = slam.pose.tolist()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = np.sin(heading / 2), np.cos(heading / 2)
    covariance[PLANAR] = slam.pose_cov
    message.pose.covariance = covariance.ravel().tolist()
    return message


def marker_messages(slam: SlamFilter, stamp: Any) -> Any:
    """Yield a cylinder for each landmark."""
    for name, (x, y) in zip(slam.landmark_ids.tolist(), slam.landmarks.tolist(), strict=True):
        marker = Marker(id=name, type=Marker.CYLINDER)
        marker.header.stamp, marker.header.frame_id = stamp, "map"
        marker.pose.position.x, marker.pose.position.y, marker.pose.orientation.w = x, y, 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = 0.3
        marker.color.b = marker.color.a = 1.0
        yield marker


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(SlamNode())
