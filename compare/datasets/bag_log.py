"""A robot's log in a ROS bag: odometry, observations and, if it is named, a ground truth."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.bag_file import NANOSECOND, Bag, header_stamp, opened
from slamgauge.compare.datasets.bag_observations import read_observations
from slamgauge.compare.datasets.imported_log import Imported, Log, Odometry, with_sigmas
from slamgauge.compare.datasets.log_settings import BagMapping, Frames, ObservationsTopic, load_settings
from slamgauge.compare.storage.files import Table, toml_text
from slamgauge.compare.storage.trajectories import Trajectory, planar_poses
from slamgauge.errors import UserError
from slamgauge.se2 import between, exp, rotation

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
REPEATED = 1000  # ns: a message so near to another one repeats its stamp
CONTRADICTS = 0.1  # share of mean squares above which motions contradict each other
PLANAR = (0, 1, 5)  # rows of x, y and heading in a covariance (6, 6) of ROS
UNKNOWN = np.zeros(36)  # covariance of a pose or a twist that is not stated


def read_bag(
    path: Path, mapping: Path | None = None, overrides: Sequence[str] = (), msgs: Sequence[Path] = ()
) -> Imported:
    """Read the recording of a bag, its truth if a topic is named, and the mapping in force.

    Args:
        path: a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.
        mapping: TOML file of the settings (`log_settings`).
        overrides: `section.key=value`, on top of it.
        msgs: folders with .msg files of types that the bag does not define.

    Raises:
        UserError: with the bag, the topic or the key, and the remedy.
    """
    with opened(path, msgs) as bag:
        settings = load_settings(BagMapping, mapping, overrides)
        notes: list[str] = []
        odometry, settings = _read_odometry(bag, settings, notes)
        settings = settings.model_copy(update={"observations": _completed(bag, settings.observations)})
        seen = read_observations(bag, settings, notes)
        true_path = None
        if settings.truth.topic is not None:
            topic = bag.topic_of(POSES, "truth.topic", settings.truth.topic)
            stamps, poses, _ = _samples(bag, topic, _pose_of, notes)
            true_path = Trajectory(topic, NANOSECOND * stamps, planar_poses(poses))
    log = Log(
        where=path,
        odometry=odometry,
        seen=seen,
        start=settings.start.pose,
        prior_cov=np.diag(settings.start.sigmas) ** 2,
        path=true_path,
        max_gap=settings.truth.max_gap,
        notes=notes,
    )
    return log.imported(settings)


def read_bag_trajectory(path: Path, topic: str) -> Trajectory:
    """Read the poses of a topic; raise `UserError` if the bag or the topic cannot be read."""
    with opened(path) as bag:
        bag.topic_of(POSES, "topic", topic)
        stamps, poses, covs = _samples(bag, topic, _pose_of, [])
    return Trajectory(f"{path}:{topic}", NANOSECOND * stamps, planar_poses(poses), covs if covs.any() else None)


def topics_text(path: Path, msgs: Sequence[Path] = ()) -> str:
    """Return a table of the topics of a bag, and a proposed mapping as TOML."""
    with opened(path, msgs) as bag:
        topics, observations = bag.topics, bag.of_types(_shipped())
        truths = [name for name in bag.of_types(POSES) if "truth" in name]
        first = {"odometry": bag.of_types(ODOMETRIES), "observations": observations, "truth": truths}
    width = max(map(len, topics), default=0)
    wide = max((len(kind) for kind, _ in topics.values()), default=0)
    lines = [f"{name:<{width}}  {kind:<{wide}}  {messages:>8}" for name, (kind, messages) in topics.items()]
    sections: dict[str, Table] = {name: {"topic": found[0]} for name, found in first.items() if found}
    if "observations" in sections:
        sections["observations"] |= _shipped()[topics[sections["observations"]["topic"]][0]]
    return "\n".join([*lines, "", "# proposed mapping", toml_text(sections)])


@cache
def _shipped() -> dict[str, Table]:
    """Return the section [observations] of each known type of message."""
    return tomllib.loads((files("slamgauge.compare.datasets") / "bag_mappings.toml").read_text(encoding="utf-8"))


def _completed(bag: Bag, section: ObservationsTopic) -> ObservationsTopic:
    """Return the section with its topic, and with the shipped paths of its type where none are stated."""
    topic = section.topic or bag.topic_of(_shipped(), "observations.topic")
    kind = bag.type_of(topic)
    stated = section.model_dump(exclude_none=True) | {"topic": topic}
    known = ObservationsTopic(**(_shipped().get(kind, {}) | stated))
    if (known.bearing is None) == (known.x is None) or (known.x is None) != (known.y is None):
        paths = "observations.x and y, or observations.range and bearing, or observations.bearing"
        raise UserError(f"{bag.path}: give paths of {topic} ({kind}): {paths}")
    return known


def _read_odometry(bag: Bag, mapping: BagMapping, notes: list[str]) -> tuple[Odometry, BagMapping]:
    """Return the odometry, and the settings with its topic and the frame of the robot; add notes.

    The covariance of a step is that of the twist, times the squared duration. Differences of poses use it too, because
    covariances of poses grow along the path.
    """
    section, children = mapping.odometry, list[str]()
    topic = bag.topic_of(ODOMETRIES, "odometry.topic", section.topic)
    where, has_poses = f"{bag.path}: {topic}", bag.type_of(topic) == ODOMETRIES[0]
    if section.kind == "poses" and not has_poses:
        raise UserError(f"{where}: has twists only; leave odometry.kind out, or name a topic of {ODOMETRIES[0]}")

    def motion(content: Any) -> tuple[list[float], Float]:
        twist = getattr(content.twist, "twist", content.twist)
        children.append(getattr(content, "child_frame_id", "").removeprefix("/"))
        pose = _pose_of(content)[0] if has_poses else [0.0] * 7
        numbers = [twist.linear.x, twist.linear.y, twist.angular.z, *pose]
        return numbers, getattr(content.twist, "covariance", UNKNOWN)

    stamps, numbers, covs = _samples(bag, topic, motion, notes)
    if len(stamps) < 2:
        raise UserError(f"{where}: {len(stamps)} messages with different stamps; odometry needs two or more")
    rows = slice(1, None) if section.holds == "since-last" else slice(None, -1)
    twists, poses, seconds = numbers[rows, :3], planar_poses(numbers[:, 3:]), NANOSECOND * np.diff(stamps)
    increments = between(poses[:-1], poses[1:])
    if section.kind == "twist":
        if has_poses:
            _require_twists_of_the_robot(where, twists, poses[rows, 2], seconds, increments)
        increments = exp(twists * seconds[:, None])
    covs = covs[rows] * seconds[:, None, None] ** 2
    noise, sigmas = mapping.noise, list[Float | None]()
    for axis, name in enumerate(("forward", "lateral", "turn")):
        stated = getattr(noise, name)
        if stated is None and name != "lateral" and not (covs[:, axis, axis] > 0.0).any():
            remedy = f"give --set noise.{name}=SIGMA"
            raise UserError(f"{where}: its messages have no variance of noise.{name}; {remedy}")
        sigmas.append(None if stated is None else stated * noise.growth(seconds))
    base = mapping.frames.base or children[-1] or "base_link"
    found = {"odometry": section.model_copy(update={"topic": topic}), "frames": Frames(base=base)}
    return Odometry(NANOSECOND * stamps, increments, with_sigmas(covs, sigmas)), mapping.model_copy(update=found)


def _require_twists_of_the_robot(where: str, twists: Float, headings: Float, seconds: Float, motions: Float) -> None:
    """Refuse twists (N, 3) that contradict the motions (N, 3) between the poses of the same messages.

    They do if all are 0, or if they agree once they are turned from the world's frame by the headings (N,).
    """
    turned = twists.copy()
    turned[:, :2] = np.einsum("nji,nj->ni", rotation(headings), twists[:, :2])
    as_read, of_world = (
        float(np.sum((exp(each * seconds[:, None]) - motions)[:, :2] ** 2)) for each in (twists, turned)
    )
    if as_read > CONTRADICTS * float(np.sum(motions[:, :2] ** 2)) and (
        of_world < CONTRADICTS * as_read or not twists.any()
    ):
        what = "the twists contradict the poses of the same messages, unless they are in the world's frame"
        raise UserError(f"{where}: {what}; give --set odometry.kind=poses")


def _pose_of(content: Any) -> tuple[list[float], Float]:
    """Return position and quaternion of a message whose type is one of `POSES`, and its covariance (36,)."""
    if hasattr(content, "transform"):
        place, turn, cov = content.transform.translation, content.transform.rotation, UNKNOWN
    else:
        pose = getattr(content.pose, "pose", content.pose)
        place, turn, cov = pose.position, pose.orientation, getattr(content.pose, "covariance", UNKNOWN)
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w], cov


def _samples(
    bag: Bag, topic: str, sample: Callable[[Any], tuple[list[float], Float]], notes: list[str]
) -> tuple[Int, Float, Float]:
    """Return the increasing stamps (n,) [ns] of a topic, numbers (n, k) and planar covariances (n, 3, 3); add notes.

    Messages are sorted by stamps. Of several messages with the same stamp the first is kept.
    """
    times, numbers, covs = list[tuple[int, int]](), list[list[float]](), list[Float]()
    for received, content in bag.messages(topic):
        times.append((header_stamp(content), received))
        row, cov = sample(content)
        numbers.append(row)
        covs.append(cov)
    stamps, order = bag.in_order(topic, times, notes)
    is_new = np.diff(stamps, prepend=stamps[:1] - 2 * REPEATED) > REPEATED
    if not is_new.all():
        notes.append(f"{topic}: {np.sum(~is_new)} messages repeat the stamp of another one and are dropped")
    rows = order[is_new]
    whole = np.array(numbers).reshape(len(numbers), -1 if numbers else 7)
    return stamps[is_new], whole[rows], np.array(covs).reshape(-1, 6, 6)[rows][:, PLANAR][:, :, PLANAR]
