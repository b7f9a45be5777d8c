"""A robot's log in a ROS bag: odometry, observations and, if it is named, a ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.bag_file import Bag, clock_checked, header_stamp, opened, seconds_of
from slamgauge.compare.datasets.bag_mapping import (
    ODOMETRIES,
    POSES,
    BagMapping,
    candidates,
    load_bag_mapping,
    shipped,
)
from slamgauge.compare.datasets.bag_observations import read_observations
from slamgauge.compare.datasets.imported_log import Imported, identified, of_file, start_pose, with_sigmas
from slamgauge.compare.datasets.synchronisation import Odometry, constant_twist, joined
from slamgauge.compare.storage.toml_tables import toml_text
from slamgauge.compare.storage.trajectories import Trajectory, interpolated, planar_covariances, planar_poses
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, rotation
from slamgauge.truth import Truth

SAME = 1000  # ns: nearer stamps of odometry are the same
CONTRADICTS = 0.1  # share of mean squares above which motions contradict each other


class PoseTopic(NamedTuple):
    """Poses (n, 3) at stamps (n,) [s], strictly increasing; covariances (n, 3, 3), None if the type has none; notes."""

    stamps: Float
    poses: Float
    covs: Float | None
    notes: tuple[str, ...]


def read_bag(
    path: Path, mapping: Path | None = None, overrides: Sequence[str] = (), msgs: Sequence[Path] = ()
) -> Imported:
    """Read the recording of a bag, its truth if a topic is named, and the mapping in force.

    Args:
        path: a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.
        mapping: TOML file of the settings (`bag_mapping`).
        overrides: `section.key=value`, on top of it.
        msgs: folders with .msg files of types that the bag does not define.

    Raises:
        UserError: with the bag, the topic or the key, and the remedy.
    """
    with opened(path, msgs) as bag:
        settings = load_bag_mapping(bag, mapping, overrides)
        odometry, base, notes = _odometry(bag, settings)
        seen = read_observations(bag, settings, base)
        landmark, kept, more = identified(seen.landmark)
        with of_file(path):
            odometry, steps, inside, outside = joined(odometry, seen.stamps[kept])
        landmark = None if landmark is None else landmark[inside]
        truth, of_truth = _truth(bag, settings, odometry.stamps, landmark)
        true_poses = None if truth is None else truth.poses
        with of_file(path):
            start, of_start = start_pose(settings.start.pose, true_poses, odometry.increments)
            recording = Recording(
                stamps=odometry.stamps,
                prior_mean=start,
                prior_cov=np.diag(settings.start.sigmas) ** 2,
                odometry=odometry.increments,
                odometry_cov=odometry.covs,
                sensor=seen.sensor,
                observation_step=steps,
                observation=seen.values[kept][inside],
                observation_cov=seen.covs[kept][inside],
                landmark=landmark,
            )
    in_force = replace(settings, ids=seen.ids, frames=replace(settings.frames, base=base))
    every = (*notes, *seen.notes, *more, *outside, *of_truth, *of_start)
    return Imported(recording, truth, every, in_force.sections(), int(np.sum(~inside)))


def read_pose_topic(bag: Bag, topic: str, clock: str = "header") -> PoseTopic:
    """Read the poses of a topic whose type is one of `POSES`, sorted by their stamps.

    The covariance of a pose is that of x, y and the rotation about z, in the frame of the header.

    Raises:
        UserError: the type is another one, or the clock jumps.
    """
    kind = bag.require(topic).type
    if kind not in POSES:
        raise UserError(f"{bag.path}: {topic} has the type {kind}; give a topic of {', '.join(POSES)}")
    rows, covs, times = list[list[float]](), list[Float](), list[tuple[int, int]]()
    for received, content in bag.messages(topic):
        times.append((header_stamp(content), received))
        if kind.endswith("TransformStamped"):
            rows.append(_pose(content.transform.translation, content.transform.rotation))
            continue
        inner = content.pose.pose if hasattr(content.pose, "pose") else content.pose
        rows.append(_pose(inner.position, inner.orientation))
        if hasattr(content.pose, "covariance"):
            covs.append(content.pose.covariance)
    stamps, kept, notes = _in_order(bag, topic, times, clock)
    poses = planar_poses(np.array(rows).reshape(-1, 7)[kept])
    return PoseTopic(seconds_of(stamps), poses, planar_covariances(np.array(covs))[kept] if covs else None, notes)


def read_bag_trajectory(path: Path, topic: str) -> Trajectory:
    """Read the poses of a topic; raise `UserError` if the bag or the topic cannot be read."""
    with opened(path) as bag:
        found = read_pose_topic(bag, topic)
    covs = found.covs if found.covs is not None and found.covs.any() else None  # zeros: not known
    return Trajectory(f"{path}:{topic}", found.stamps, found.poses, covs)


def topics_text(path: Path, msgs: Sequence[Path] = ()) -> str:
    """Return a table of the topics of a bag, and a proposed mapping as TOML."""
    with opened(path, msgs) as bag:
        topics = bag.topics()
        width = max(map(len, topics), default=0)
        wide = max((len(topic.type) for topic in topics.values()), default=0)
        lines = [f"{name:<{width}}  {topic.type:<{wide}}  {topic.messages:>8}" for name, topic in topics.items()]
        first = {
            "odometry": candidates(bag, ODOMETRIES),
            "observations": candidates(bag, tuple(shipped())),
            "truth": [name for name in candidates(bag, POSES) if "truth" in name],
        }
        sections: dict[str, dict[str, Any]] = {name: {"topic": each[0]} for name, each in first.items() if each}
        if "observations" in sections:
            sections["observations"] |= shipped()[topics[sections["observations"]["topic"]].type]
    missing = [name for name in ("odometry", "observations") if name not in sections]
    remarks = [f"# no topic of a known type for [{name}]: state its topic and paths" for name in missing]
    return "\n".join([*lines, "", "# proposed mapping", *remarks, toml_text(sections)])


def _odometry(bag: Bag, mapping: BagMapping) -> tuple[Odometry, str, tuple[str, ...]]:
    """Return the odometry, the frame of the robot and notes.

    The covariance of a step is that of the twist, times the squared duration. Differences of poses use it too, because
    the covariances of poses grow along the path.
    """
    section, topic = mapping.odometry, mapping.odometry.topic or ""
    where = f"{bag.path}: {topic}"
    stamped = bag.require(topic).type != ODOMETRIES[0]
    if stamped and section.kind == "poses":
        raise UserError(f"{where}: has twists only; leave odometry.kind out, or name a topic of {ODOMETRIES[0]}")
    times, covs, child = list[tuple[int, int]](), list[Float](), ""
    twists, poses = list[list[float]](), list[list[float]]()
    for received, content in bag.messages(topic):
        times.append((header_stamp(content), received))
        inner = content.twist.twist if hasattr(content.twist, "twist") else content.twist
        twists.append([inner.linear.x, inner.linear.y, inner.angular.z])
        covs.append(getattr(content.twist, "covariance", np.zeros(36)))
        if not stamped:
            child = content.child_frame_id.removeprefix("/")
            poses.append(_pose(content.pose.pose.position, content.pose.pose.orientation))
    stamps, kept, notes = _in_order(bag, topic, times, mapping.frames.clock)
    if len(stamps) < 2:
        raise UserError(f"{where}: {len(stamps)} messages with different stamps; odometry needs two or more")
    rows = slice(1, None) if section.holds == "since-last" else slice(None, -1)
    velocities, seconds = np.array(twists)[kept], seconds_of(np.diff(stamps))
    path = planar_poses(np.array(poses)[kept]) if poses else np.zeros((len(stamps), 3))
    increments = between(path[:-1], path[1:])
    if section.kind == "twist":
        if poses:
            _require_twists_of_the_robot(where, velocities[rows], path[rows, 2], seconds, increments)
        increments = constant_twist(velocities[rows], seconds)
    wild = np.abs(increments[:, 2]) > np.pi
    if wild.any():
        at = int(np.argmax(wild))
        what = f"the robot turns by {increments[at, 2]:.3g} rad before stamp {1e-9 * stamps[at + 1]:.9f} s"
        raise UserError(f"{where}: {what}; check the units of twists, and gaps of the topic")
    covariances = planar_covariances(np.array(covs))[kept][rows] * seconds[:, None, None] ** 2
    with of_file(bag.path):
        noise = _step_noise(covariances, seconds, mapping, topic)
    return Odometry(seconds_of(stamps), increments, noise), mapping.frames.base or child or "base_link", notes


def _require_twists_of_the_robot(
    where: str, velocities: Float, headings: Float, seconds: Float, motions: Float
) -> None:
    """Refuse twists (N, 3) that contradict the motions (N, 3) between the poses of the same messages.

    They do if all are 0, or if the motions agree with them only once they are turned from the world's frame by the
    headings (N,).
    """
    if not velocities.any() and motions.any():
        raise UserError(f"{where}: all twists are 0, but the poses move; give --set odometry.kind=poses")
    turned = velocities.copy()
    turned[:, :2] = np.einsum("nji,nj->ni", rotation(headings), velocities[:, :2])
    as_read, of_world = (
        float(np.sum((constant_twist(each, seconds) - motions)[:, :2] ** 2)) for each in (velocities, turned)
    )
    if as_read > CONTRADICTS * float(np.sum(motions[:, :2] ** 2)) and of_world < CONTRADICTS * as_read:
        what = "the twists contradict the poses of the same messages, unless they are in the world's frame"
        raise UserError(f"{where}: {what}; give --set odometry.kind=poses")


def _step_noise(covs: Float, seconds: Float, mapping: BagMapping, topic: str) -> Float:
    """Return covariances (N, 3, 3) in which stated standard deviations replace variances and their correlations."""
    noise = mapping.noise
    growth = {"step": np.ones_like(seconds), "second": np.sqrt(seconds), "speed": seconds}[noise.per]
    sigmas = {"forward": noise.forward, "lateral": noise.lateral, "turn": noise.turn}
    for axis, (name, sigma) in enumerate(sigmas.items()):
        if sigma is None and name != "lateral" and not (covs[:, axis, axis] > 0.0).any():
            raise UserError(f"{topic}: its messages have no variance of noise.{name}; give --set noise.{name}=SIGMA")
    return with_sigmas(covs, [None if sigma is None else sigma * growth for sigma in sigmas.values()])


def _truth(bag: Bag, mapping: BagMapping, stamps: Float, landmark: Any) -> tuple[Truth | None, tuple[str, ...]]:
    """Return the ground truth at the stamps (N+1,) of the steps, and notes; None without a topic."""
    if mapping.truth.topic is None:
        return None, ()
    found = read_pose_topic(bag, mapping.truth.topic, mapping.frames.clock)
    if not len(found.stamps):
        raise UserError(f"{bag.path}: {mapping.truth.topic}: has no messages; leave truth.topic out")
    poses = interpolated(found.stamps, found.poses, stamps, mapping.truth.max_gap)
    return Truth(poses=poses, association=landmark), found.notes


def _in_order(bag: Bag, topic: str, times: Sequence[tuple[int, int]], clock: str) -> tuple[Int, Int, tuple[str, ...]]:
    """Return increasing stamps [ns] of a topic, the indices of their messages, and notes.

    Messages are sorted by stamps. Of several messages with the same stamp the first is kept.
    """
    stamps, received = np.array(times, dtype=np.int64).reshape(-1, 2).T
    stamps, notes = (received, ()) if clock == "recording" else clock_checked(f"{bag.path}: {topic}", stamps, received)
    order = np.argsort(stamps, kind="stable")
    kept = order[np.append(True, np.diff(stamps[order]) > SAME)[: len(order)]]
    late, same = int(np.sum(np.diff(stamps) < -SAME)), len(order) - len(kept)
    if late:
        notes += (f"{topic}: {late} messages have a stamp before that of the message before them; sorted by stamps",)
    if same:
        notes += (f"{topic}: {same} messages repeat the stamp of another one and are dropped",)
    return stamps[kept], kept, notes


def _pose(position: Any, orientation: Any) -> list[float]:
    """Return position and quaternion as the row of 7 numbers that `planar_poses` reads."""
    return [position.x, position.y, position.z, orientation.x, orientation.y, orientation.z, orientation.w]
