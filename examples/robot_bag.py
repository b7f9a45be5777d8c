"""Write a ROS 2 bag of a simulated robot: `python examples/robot_bag.py run-1`.

/odom          nav_msgs/Odometry, ten times a second, with the covariance of its twists
/reflectors    robot_msgs/Reflectors, a type of our own: ids, ranges and bearings in the frame of the robot
/ekf/pose      geometry_msgs/PoseWithCovarianceStamped, the robot's own filter, which states half of its sigmas
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from slamgauge import ekf_slam, simulate
from slamgauge.se2 import log

SCENARIO, SEED, BEGINNING = "q1-short-dense", 3, 1_700_000_000  # s: time of the robot's clock at the start
OWN_TYPES = {
    "robot_msgs/msg/Reflectors": "std_msgs/Header header\nrobot_msgs/Reflector[] reflectors\n",
    "robot_msgs/msg/Reflector": "int32 id\nfloat64 range\nfloat64 bearing\n",
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in OWN_TYPES.items():
    STORE.register(get_types_from_msg(text, name))
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and heading in a covariance of ROS


def main(folder: Path) -> None:
    """Write the bag."""
    _, recording = simulate(SCENARIO, SEED)
    estimate = ekf_slam(recording)
    assert estimate.pose_covs is not None and recording.landmark is not None
    seconds = np.diff(recording.stamps)
    twists = np.vstack([np.zeros(3), log(recording.odometry) / seconds[:, None]])
    covs = np.concatenate([recording.odometry_cov[:1], recording.odometry_cov]) / seconds.mean() ** 2
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {
            "/odom": "nav_msgs/msg/Odometry",
            "/reflectors": "robot_msgs/msg/Reflectors",
            "/ekf/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
        }
        topics = {name: writer.add_connection(name, kind, typestore=STORE) for name, kind in kinds.items()}
        for k, stamp in enumerate(recording.stamps):
            time = 10**9 * BEGINNING + round(1e9 * stamp)
            x, y, heading = estimate.poses[k]
            rows = np.flatnonzero(recording.observation_step == k)
            messages = {
                "/odom": odometry(time, twists[k], covs[k]),
                "/reflectors": reflectors(time, recording.landmark[rows], recording.observation[rows]),
                "/ekf/pose": make(
                    kinds["/ekf/pose"],
                    header=header(time, "map"),
                    pose=with_covariance("Pose", pose(x, y, heading), 0.25 * estimate.pose_covs[k]),
                ),
            }
            for topic, message in messages.items():
                writer.write(topics[topic], time, STORE.serialize_cdr(message, kinds[topic]))


def make(kind: str, **fields: Any) -> Any:
    """Return a message."""
    return STORE.types[kind](**fields)


def header(time: int, frame: str) -> Any:
    """Return a header with a stamp [ns]."""
    stamp = make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(kind: str, x: float, y: float, z: float) -> Any:
    """Return a Vector3 or a Point."""
    return make(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=float(z))


def pose(x: float, y: float, heading: float) -> Any:
    """Return a planar pose."""
    turn = make(
        "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(heading / 2)), w=float(np.cos(heading / 2))
    )
    return make("geometry_msgs/msg/Pose", position=vector("Point", x, y, 0.0), orientation=turn)


def with_covariance(kind: str, content: Any, cov: Any) -> Any:
    """Return a PoseWithCovariance or a TwistWithCovariance with the covariance (3, 3) of its planar part."""
    whole = np.zeros((6, 6))
    whole[PLANAR] = cov
    return make(f"geometry_msgs/msg/{kind}WithCovariance", **{kind.lower(): content}, covariance=whole.ravel())


def odometry(time: int, twist: Any, cov: Any) -> Any:
    """Return the odometry with a twist (3,)."""
    forward = make(
        "geometry_msgs/msg/Twist",
        linear=vector("Vector3", twist[0], twist[1], 0.0),
        angular=vector("Vector3", 0.0, 0.0, twist[2]),
    )
    return make(
        "nav_msgs/msg/Odometry",
        header=header(time, "odom"),
        child_frame_id="base_link",
        pose=with_covariance("Pose", pose(0.0, 0.0, 0.0), np.zeros((3, 3))),
        twist=with_covariance("Twist", forward, cov),
    )


def reflectors(time: int, ids: Any, values: Any) -> Any:
    """Return the observations (m, 2) of a step."""
    kind = "robot_msgs/msg/Reflector"
    found = [
        make(kind, id=int(name), range=float(r), bearing=float(b)) for name, (r, b) in zip(ids, values, strict=True)
    ]
    return make("robot_msgs/msg/Reflectors", header=header(time, "base_link"), reflectors=found)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "run-1"))
