"""Settings for reading a ROS bag, from a TOML file and `--set`.

    [odometry]      topic, kind (twist, poses), holds (since-last, until-next)
    [observations]  topic, array, x, y, z or range, bearing, id, pattern, covariance
    [noise]         forward, lateral, turn, per (step, second, speed); range, bearing, position: [m, rad]
    [start]         pose, sigmas: [m, m, rad]
    [truth]         topic, max_gap
    [frames]        base, clock (header, recording)
    [transforms]    SENSOR = [x, y, heading] of a sensor frame in the base frame [m, m, rad]
    [ids]           NAME = number of a landmark whose id in the messages is a text

Every key has a default. A topic that is not stated is the only one of a known type. Known types of observations have
their paths in `bag_mappings.toml`. A stated standard deviation replaces the variance in the messages.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from slamgauge.compare.datasets.bag_file import Bag
from slamgauge.compare.datasets.csv_mapping import Noise, StartPose
from slamgauge.compare.datasets.settings import Id, Pose, Section, Sigma, Text, load_settings
from slamgauge.compare.storage.toml_tables import Table
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

ODOMETRIES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/TwistWithCovarianceStamped",
)
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
Paths = Text | Annotated[list[Text], Field(min_length=1)]  # paths into a message: one, or several
TREES = ("/tf", "/tf_static")  # read as observations only if they are named


@dataclass(frozen=True)
class OdometryTopic(Section):
    """Odometry: increments from twists, or from differences of poses. A twist is valid since the last message."""

    topic: Text | None = None
    kind: Literal["twist", "poses"] = "twist"
    holds: Literal["since-last", "until-next"] = "since-last"


@dataclass(frozen=True)
class ObservationsTopic(Section):
    """Observations of landmarks: paths into a message, and from there into an element of `array`.

    Paths are names and indices with dots between them: results.0.pose.pose.position.x. Of several paths in `id`, the
    first is used that leads to a number or a text. Elements whose id does not match `pattern` are dropped; its first
    group is the id.
    """

    topic: Text | None = None
    array: Paths | None = None
    x: Text | None = None
    y: Text | None = None
    z: Text | None = None
    range: Text | None = None
    bearing: Text | None = None
    id: Paths | None = None
    pattern: Text | None = None
    covariance: Text | None = None


@dataclass(frozen=True)
class BagNoise(Noise):
    """The same standard deviations; those that are not stated are those of the messages."""

    lateral: Sigma | None = None
    per: Literal["step", "second", "speed"] = "speed"


@dataclass(frozen=True)
class TruthTopic(Section):
    """Poses of the ground truth. They are not interpolated over gaps longer than `max_gap` [s]."""

    topic: Text | None = None
    max_gap: Sigma = 1.0


@dataclass(frozen=True)
class Frames(Section):
    """Frame of the robot (by default the child frame of the odometry, else base_link) and the source of stamps."""

    base: Text | None = None
    clock: Literal["header", "recording"] = "header"


@dataclass(frozen=True)
class BagMapping(Section):
    """All sections."""

    odometry: OdometryTopic = field(default_factory=OdometryTopic)
    observations: ObservationsTopic = field(default_factory=ObservationsTopic)
    noise: BagNoise = field(default_factory=BagNoise)
    start: StartPose = field(default_factory=StartPose)
    truth: TruthTopic = field(default_factory=TruthTopic)
    frames: Frames = field(default_factory=Frames)
    transforms: dict[str, Pose] = field(default_factory=dict[str, Pose])
    ids: dict[str, Id] = field(default_factory=dict[str, Id])

    def sections(self) -> dict[str, dict[str, Any]]:
        """Return the sections that are not empty as tables."""
        return {name: table for name, table in asdict(self).items() if table}


@cache
def shipped() -> dict[str, Table]:
    """Return the section [observations] of each known type of message."""
    return tomllib.loads((files("slamgauge.compare.datasets") / "bag_mappings.toml").read_text(encoding="utf-8"))


def load_bag_mapping(bag: Bag, file: Path | None, overrides: Sequence[str]) -> BagMapping:
    """Load the settings for a bag: those of a file, overrides on top, and defaults found in the bag.

    Args:
        bag: the bag, whose topics and types complete the settings.
        file: TOML file of the sections; None for defaults only.
        overrides: `section.key=value`, on top of the file.

    Raises:
        UserError: a key, a value or a topic is wrong, or a topic must be stated.
    """
    mapping = load_settings(BagMapping, file, overrides)
    if mapping.truth.topic is not None:
        _require_type(bag, mapping.truth.topic, POSES, "truth.topic")
    odometry = mapping.odometry.topic or only_topic(bag, ODOMETRIES, "odometry.topic")
    _require_type(bag, odometry, ODOMETRIES, "odometry.topic")
    return replace(
        mapping,
        odometry=replace(mapping.odometry, topic=odometry),
        observations=_completed(bag, mapping.observations),
    )


def candidates(bag: Bag, types: Sequence[str]) -> list[str]:
    """Return the topics of a bag that have one of the types and at least one message."""
    topics = bag.topics().items()
    return [name for name, topic in topics if topic.type in types and topic.messages and name not in TREES]


def only_topic(bag: Bag, types: Sequence[str], key: str) -> str:
    """Return the only topic with one of the types; raise UserError if several exist, or none."""
    found = candidates(bag, types)
    if len(found) == 1:
        return found[0]
    reason = f"several topics fit ({', '.join(found)})" if found else f"no topic has a known type ({', '.join(types)})"
    raise UserError(f"{bag.path}: {reason}; give --set {key}=TOPIC, `--list` lists all topics")


def _completed(bag: Bag, section: ObservationsTopic) -> ObservationsTopic:
    """Return the section with its topic, and with the shipped paths of its type where none are stated."""
    topic = section.topic or only_topic(bag, tuple(shipped()), "observations.topic")
    kind = bag.require(topic).type
    stated = {name: value for name, value in asdict(section).items() if value is not None}
    complete: dict[str, Any] = shipped().get(kind, {}) | stated | {"topic": topic}
    known = ObservationsTopic(**complete)
    if (known.bearing is None) == (known.x is None) or (known.x is None) != (known.y is None):
        paths = "observations.x and y, or observations.range and bearing, or observations.bearing"
        raise UserError(f"{bag.path}: give paths of {topic} ({kind}): {paths}")
    return known


def _require_type(bag: Bag, topic: str, types: Sequence[str], key: str) -> None:
    kind = bag.require(topic).type
    if kind not in types:
        raise UserError(f"{bag.path}: {key}: {topic} has the type {kind}; {did_you_mean(kind, types)}")
