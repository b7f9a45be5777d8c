"""The filter as a ROS 2 node: /odom and /detections (in the frame of the robot) to /slam/pose and /slam/landmarks."""

import numpy as np
import rclpy
from geometry_msgs.msg import Point, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from vision_msgs.msg import Detection3DArray
from visualization_msgs.msg import Marker

from slamgauge import Observations, SlamFilter, se2

PLANAR = np.eye(6)[[0, 1, 5]]  # x, y and heading in a covariance of ROS


class SlamNode(Node):
    """Right-invariant EKF-SLAM with known ids; a detection is used at the latest odometry before it."""

    def __init__(self) -> None:
        super().__init__("slamgauge")
        self.slam = SlamFilter("position", np.zeros(3), np.zeros((3, 3)), "right-invariant")
        self.stamp = np.inf  # s, of the last odometry
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "/slam/pose", 10)
        self.map = self.create_publisher(Marker, "/slam/landmarks", 10)
        self.create_subscription(Odometry, "/odom", self.predict, 50)
        self.create_subscription(Detection3DArray, "/detections", self.update, 50)

    def predict(self, message: Odometry) -> None:
        """Move by the twist, which is valid since the last odometry message."""
        stamp, twist = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, message.twist.twist
        if (dt := stamp - self.stamp) > 0.0:
            cov = PLANAR @ np.reshape(message.twist.covariance, (6, 6)) @ PLANAR.T
            self.slam.predict(se2.exp(dt * np.array([twist.linear.x, twist.linear.y, twist.angular.z])), dt**2 * cov)
        self.stamp = stamp

    def update(self, message: Detection3DArray) -> None:
        """Correct with all detections of a message, and publish pose and landmarks."""
        found = [(int(each.id), each.results[0].pose) for each in message.detections if each.results]
        values = np.array([[each.pose.position.x, each.pose.position.y] for _, each in found]).reshape(-1, 2)
        covs = np.array([np.reshape(each.covariance, (6, 6))[:2, :2] for _, each in found]).reshape(-1, 2, 2)
        ids = np.array([name for name, _ in found], dtype=np.int64)
        self.slam.update(Observations(ids, values, covs), gate=13.8)  # true ones exceed it with probability 0.001
        pose, (x, y, heading) = PoseWithCovarianceStamped(), self.slam.pose.tolist()
        pose.header.stamp, pose.header.frame_id = message.header.stamp, "map"
        pose.pose.pose.position, turned = Point(x=x, y=y), pose.pose.pose.orientation
        turned.z, turned.w = np.sin(heading / 2), np.cos(heading / 2)
        pose.pose.covariance = (PLANAR.T @ self.slam.pose_cov @ PLANAR).ravel().tolist()
        self.poses.publish(pose)
        points = [Point(x=x, y=y) for x, y in self.slam.landmarks.tolist()]
        marker = Marker(header=pose.header, type=Marker.SPHERE_LIST, points=points)
        marker.scale.x = marker.scale.y = marker.scale.z = 0.3  # m
        marker.color.b = marker.color.a = marker.pose.orientation.w = 1.0
        self.map.publish(marker)


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(SlamNode())
