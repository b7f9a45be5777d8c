"""ROS bags of recordings, written with rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from slamgauge.arrays import Float
from slamgauge.recording import Recording
from slamgauge.se2 import chain, log

KINDS = ("ros1", "sqlite3", "mcap")
SCAN = "std_msgs/Header header\nrobot_msgs/Landmark[] landmarks\n"
LANDMARK = "int32 id\nfloat64 range\nfloat64 bearing\nfloat64[4] covariance\n"
OWN_MSGS = {"robot_msgs/msg/Scan": SCAN, "robot_msgs/msg/Landmark": LANDMARK}
POSED = "geometry_msgs/PoseWithCovariance pose\n"
MSGS = OWN_MSGS | {  # fields of types that rosbags does not have
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\n"
        "string id\n"
    ),
    "vision_msgs/msg/ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\n" + POSED,
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "apriltag_ros/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections\n"
    ),
    "apriltag_ros/msg/AprilTagDetection": "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose\n",
    "fiducial_msgs/msg/FiducialTransformArray": (
        "std_msgs/Header header\nint32 image_seq\nfiducial_msgs/FiducialTransform[] transforms\n"
    ),
    "fiducial_msgs/msg/FiducialTransform": (
        "int32 fiducial_id\ngeometry_msgs/Transform transform\nfloat64 image_error\nfloat64 object_error\n"
        "float64 fiducial_area\n"
    ),
    "eufs_msgs/msg/ConeArrayWithCovariance": "std_msgs/Header header\n"
    + "".join(
        f"eufs_msgs/ConeWithCovariance[] {name}_cones\n"
        for name in ("blue", "yellow", "orange", "big_orange", "unknown_color")
    ),
    "eufs_msgs/msg/ConeWithCovariance": "geometry_msgs/Point point\nfloat64[4] covariance\n",
}
Message = tuple[str, int, str, dict[str, Any]]  # topic, time of recording [ns], type, fields


class Bags:
    """Writes bags of one kind, compressed with bz2 (ROS 1), zstd (MCAP) or as a file (sqlite3) if `compressed`."""

    def __init__(self, kind: str, *, compressed: bool = False) -> None:
        self.kind, self.compressed = kind, compressed
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        types = {k: v for name, text in MSGS.items() for k, v in get_types_from_msg(text, name).items()}
        self.store.register({name: value for name, value in types.items() if name not in self.store.fielddefs})

    def write(self, path: Path, messages: Iterable[Message]) -> Path:
        """Write messages in the order given; the suffix of a ROS 1 bag is added. Return the path of the bag."""
        writer: Any
        if self.kind == "ros1":
            path = path.with_suffix(".bag")
            ros1 = rosbag1.Writer(path)
            if self.compressed:
                ros1.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
            writer, serialize = ros1, self.store.serialize_ros1
        else:
            plugin = getattr(rosbag2.StoragePlugin, self.kind.upper())
            ros2 = rosbag2.Writer(path, version=9, storage_plugin=plugin)
            if self.compressed:
                mode = rosbag2.CompressionMode.STORAGE if self.kind == "mcap" else rosbag2.CompressionMode.FILE
                ros2.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
            writer, serialize = ros2, self.store.serialize_cdr
        topics: dict[str, Any] = {}
        with writer:
            for topic, received, kind, fields in messages:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(topics[topic], received, serialize(self.made(kind, fields), kind))
        return path

    def made(self, kind: str, fields: dict[str, Any]) -> Any:
        """Return a message with the given fields, and zeros elsewhere."""
        types = dict(self.store.fielddefs[kind][1])
        assert fields.keys() <= types.keys(), (kind, fields.keys() - types.keys())
        return self.store.types[kind](**{name: self._value(each, fields.get(name)) for name, each in types.items()})

    def _value(self, field: Any, value: Any) -> Any:
        node, detail = field
        if node == Nodetype.NAME:
            return self.made(detail, value or {})
        if node == Nodetype.BASE:
            return value if value is not None else "" if detail[0] == "string" else 0
        inner, size = detail
        if inner[0] == Nodetype.BASE and inner[1][0] != "string":
            return np.asarray(np.zeros(size) if value is None else value, dtype=inner[1][0])
        return [self._value(inner, each) for each in value or []]


def nanoseconds(stamp: float) -> int:
    return round(stamp * 1e9)


def header(stamp: float, frame: str = "base_link") -> dict[str, Any]:
    time = nanoseconds(stamp)
    return {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}, "frame_id": frame}


def xyz(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": float(x), "y": float(y), "z": float(z)}


def yaw(heading: float) -> dict[str, float]:
    return {"z": float(np.sin(heading / 2)), "w": float(np.cos(heading / 2))}


def six(planar: Float) -> Float:
    """Return a covariance (3, 3) of x, y and heading as 36 numbers."""
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = planar
    return whole.ravel()


def odometry_messages(recording: Recording, topic: str = "/odom") -> list[Message]:
    """Return odometry whose twists lead from message to message, and whose poses are their path."""
    stamps = [nanoseconds(stamp) for stamp in recording.stamps]
    seconds = 1e-9 * np.diff(stamps)
    twists = np.vstack([np.zeros(3), log(recording.odometry) / seconds[:, None]])
    covs = np.concatenate([np.zeros((1, 3, 3)), recording.odometry_cov / seconds[:, None, None] ** 2])
    poses = chain(np.zeros(3), recording.odometry)
    return [
        (
            topic,
            nanoseconds(stamp),
            "nav_msgs/msg/Odometry",
            {
                "header": header(stamp, "odom"),
                "child_frame_id": "base_link",
                "pose": {"pose": {"position": xyz(*pose[:2]), "orientation": yaw(pose[2])}},
                "twist": {
                    "twist": {"linear": xyz(*twist[:2]), "angular": xyz(0, 0, twist[2])},
                    "covariance": six(cov),
                },
            },
        )
        for stamp, pose, twist, cov in zip(recording.stamps, poses, twists, covs, strict=True)
    ]


def scan_messages(
    recording: Recording, topic: str, kind: str, content: Callable[[int, Float, Float], Any], array: str, **more: Any
) -> list[Message]:
    """Return a message for each step with observations; `content` makes an element of id, value and covariance."""
    found: list[Message] = []
    ids = np.full(len(recording.observation), -1) if recording.landmark is None else recording.landmark
    for step in np.unique(recording.observation_step):
        rows = np.flatnonzero(recording.observation_step == step)
        stamp = float(recording.stamps[step])
        elements = [content(int(ids[i]), recording.observation[i], recording.observation_cov[i]) for i in rows]
        found.append((topic, nanoseconds(stamp), kind, {"header": header(stamp), array: elements} | more))
    return found


def own_scan(name: int, value: Float, cov: Float) -> dict[str, Any]:
    return {"id": name, "range": float(value[0]), "bearing": float(value[1]), "covariance": cov.ravel()}


def detection(name: int, value: Float, cov: Float) -> dict[str, Any]:
    whole = np.zeros((3, 3))
    whole[:2, :2] = cov
    return {
        "id": str(name),
        "results": [{"pose": {"pose": {"position": xyz(*value)}, "covariance": six(whole)}}],
    }


def in_order(*groups: list[Message]) -> list[Message]:
    """Return the messages of several topics in the order of recording."""
    return sorted((each for group in groups for each in group), key=lambda message: message[1])
