"""ROS bags import to the recording that they were written from, or are refused in one line."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.datasets.bag_log import read_bag
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.files import load_recording, load_truth, save
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain, compose, rotation
from slamgauge.sensors import inverse, inverse_jacobian
from tests.reference.bags import (
    KINDS,
    Bags,
    Message,
    detection,
    header,
    in_order,
    nanoseconds,
    odometry_messages,
    own_scan,
    scan_messages,
    six,
    xyz,
)
from tests.reference.command_line import run
from tests.reference.given import given
from tests.reference.random_recordings import random_recording

Element = Callable[[int, Float, Float], dict[str, Any]]
OWN = (
    "observations.topic=/scan",
    "observations.array=landmarks",
    "observations.range=range",
    "observations.bearing=bearing",
    "observations.id=id",
    "observations.covariance=covariance",
)
NOISE = "noise.position=0.3"


def simulated(sensor: str = "position", start: float = 1000.0) -> Recording:
    _, recording = random_recording(4, sensor=sensor)
    return replace(recording, stamps=start + recording.stamps, prior_mean=np.zeros(3), prior_cov=np.zeros((3, 3)))


RECORDING = simulated()
WITH_NOISE = replace(RECORDING, observation_cov=np.eye(2) * 0.3**2)


def detections(recording: Recording) -> list[Message]:
    return scan_messages(recording, "/detections", "vision_msgs/msg/Detection3DArray", detection, "detections")


def own_scans(recording: Recording) -> list[Message]:
    return scan_messages(recording, "/scan", "robot_msgs/msg/Scan", own_scan, "landmarks")


def bag(folder: Path, *groups: list[Message], kind: str = "mcap", compressed: bool = False) -> Path:
    """Write a bag of some topics, by default of the odometry and of detections."""
    groups = groups or (odometry_messages(RECORDING), detections(RECORDING))
    return Bags(kind, compressed=compressed).write(folder / "run", in_order(*groups))


def assert_same(found: Recording, written: Recording) -> None:
    assert_allclose(found.stamps, written.stamps, rtol=0, atol=1e-6)
    for name in ("odometry", "odometry_cov", "observation", "observation_cov"):
        assert_allclose(getattr(found, name), getattr(written, name), rtol=0, atol=1e-9, err_msg=name)
    assert_array_equal(found.observation_step, written.observation_step)
    assert_array_equal(found.landmark, written.landmark)
    assert found.sensor == written.sensor


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("start", "compressed"), [(0.0, False), (1.7e9, False), (1000.0, True)])
def test_detections_with_twists(kind: str, start: float, compressed: bool, tmp_path: Path):
    recording = simulated(start=start)
    path = bag(tmp_path, odometry_messages(recording), detections(recording), kind=kind, compressed=compressed)
    found = read_bag(path)
    assert_same(found.recording, recording)
    assert found.notes == ()


def test_a_message_type_of_ones_own_with_poses(tmp_path: Path):
    recording = simulated("range-bearing")
    path = bag(tmp_path, odometry_messages(recording), own_scans(recording))
    assert_same(read_bag(path, overrides=[*OWN, "odometry.kind=poses"]).recording, recording)


# --- shipped mappings -----------------------------------------------------------------------------


def fiducial(number: int, value: Float, _cov: Float) -> dict[str, Any]:
    return {"fiducial_id": number, "transform": {"translation": xyz(*value)}}


def tag(number: int, value: Float, cov: Float) -> dict[str, Any]:
    whole = np.zeros((3, 3))
    whole[:2, :2] = cov
    pose = {"pose": {"position": xyz(*value)}, "covariance": six(whole)}
    return {"id": [number], "pose": {"header": header(0.0), "pose": pose}}


def cone(_number: int, value: Float, cov: Float) -> dict[str, Any]:
    return {"point": xyz(*value), "covariance": cov.ravel()}


@pytest.mark.parametrize(
    ("kind", "array", "element", "recording"),
    [
        ("vision_msgs/msg/Detection3DArray", "detections", detection, RECORDING),
        ("apriltag_ros/msg/AprilTagDetectionArray", "detections", tag, RECORDING),
        ("fiducial_msgs/msg/FiducialTransformArray", "transforms", fiducial, WITH_NOISE),
        ("eufs_msgs/msg/ConeArrayWithCovariance", "yellow_cones", cone, replace(RECORDING, landmark=None)),
    ],
)
def test_known_types(kind: str, array: str, element: Element, recording: Recording, tmp_path: Path):
    scans = scan_messages(recording, "/seen", kind, element, array)
    path = bag(tmp_path, odometry_messages(recording), scans, kind="ros1")
    assert_same(read_bag(path, overrides=[NOISE] if recording is WITH_NOISE else []).recording, recording)


def test_markers_that_are_deleted_are_no_observations(tmp_path: Path):
    """The stamps and frames of an array without a header are those of its markers."""
    messages = list[Message]()
    for topic, received, _, fields in detections(RECORDING):
        own = {"header": fields["header"], "type": 2}
        there = [
            own | {"id": int(each["id"]), "pose": {"position": each["results"][0]["pose"]["pose"]["position"]}}
            for each in fields["detections"]
        ]
        gone = own | {"id": 99, "action": 2}
        messages.append((topic, received, "visualization_msgs/msg/MarkerArray", {"markers": [*there, gone]}))
    path = bag(tmp_path, odometry_messages(RECORDING), messages)
    assert_same(read_bag(path, overrides=[NOISE]).recording, WITH_NOISE)


def test_tags_of_apriltag_ros_on_tf(tmp_path: Path):
    """Transforms of other frames are dropped, and a camera's axes are turned into the robot's by static transforms."""
    camera = {"translation": xyz(0.3, 0.1, 0.5), "rotation": {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}}  # optical
    mount = {"header": header(0.0, "base_link"), "child_frame_id": "camera", "transform": camera}
    static = ("/tf_static", nanoseconds(1000.0), "tf2_msgs/msg/TFMessage", {"transforms": [mount]})
    messages = list[Message]()
    for _, received, _, fields in detections(RECORDING):
        own = {"header": fields["header"] | {"frame_id": "camera"}}
        there = [own | {"child_frame_id": "tag36h11:none", "transform": {"translation": xyz(9, 9)}}]
        for each in fields["detections"]:
            position = each["results"][0]["pose"]["pose"]["position"]
            place = xyz(0.1 - position["y"], 0.5, position["x"] - 0.3)
            there.append(own | {"child_frame_id": f"tag36h11:{each['id']}", "transform": {"translation": place}})
        messages.append(("/tf", received, "tf2_msgs/msg/TFMessage", {"transforms": there}))
    path = bag(tmp_path, [static], odometry_messages(RECORDING), messages, kind="sqlite3")
    assert_same(read_bag(path, overrides=[NOISE, "observations.topic=/tf"]).recording, WITH_NOISE)


def test_ranges_and_bearings_of_a_mounted_laser(tmp_path: Path):
    recording = simulated("range-bearing")
    scans = own_scans(recording)
    for _, _, _, fields in scans:
        fields["header"]["frame_id"] = "laser"
    mount = np.array([0.4, -0.1, np.pi / 2])
    path = bag(tmp_path, odometry_messages(recording), scans)
    found = read_bag(path, overrides=[*OWN, f"transforms.laser={mount.tolist()}"]).recording

    def landmarks(of: Recording, sensor: Float) -> Float:
        return compose(sensor, np.column_stack([inverse(of.sensor, of.observation), np.zeros(len(of.observation))]))

    def in_plane(of: Recording) -> Float:
        B = inverse_jacobian(of.sensor, of.observation)
        return B @ of.observation_cov @ B.swapaxes(1, 2)

    assert_allclose(landmarks(found, np.zeros(3))[:, :2], landmarks(recording, mount)[:, :2], atol=1e-12)
    turn = rotation(mount[2])
    assert_allclose(in_plane(found), turn @ in_plane(recording) @ turn.T, atol=1e-12)


# --- logs with faults -----------------------------------------------------------------------------


def test_late_and_repeated_messages_change_nothing(tmp_path: Path):
    moves, seen = odometry_messages(RECORDING), detections(RECORDING)
    received = [message[1] for message in moves]
    moves[3], moves[4] = moves[4], moves[3]  # in the order of writing
    moves = [(topic, time, kind, fields) for time, (topic, _, kind, fields) in zip(received, moves, strict=True)]
    repeated = [(topic, time + 5, kind, fields) for topic, time, kind, fields in moves[5:9]]
    found = read_bag(bag(tmp_path, moves, seen, repeated, kind="ros1"))
    assert_same(found.recording, RECORDING)
    assert found.notes == ("/odom: 4 messages repeat the stamp of another one and are dropped",)


def test_without_stamps_in_headers_the_times_of_recording_are_used(tmp_path: Path):
    groups = odometry_messages(RECORDING), detections(RECORDING)
    for *_, fields in (*groups[0], *groups[1]):
        fields["header"] = header(0.0, fields["header"]["frame_id"])
    found = read_bag(bag(tmp_path, *groups, kind="ros1"))
    assert "/odom: no stamps in its headers; times of recording are used" in " ".join(found.notes)
    assert_same(found.recording, RECORDING)


def test_twists_in_the_frame_of_the_world_contradict_the_poses(tmp_path: Path):
    moves = odometry_messages(RECORDING)
    headings = chain(np.zeros(3), RECORDING.odometry)[:, 2]
    for (*_, fields), heading in zip(moves, headings, strict=True):
        linear = fields["twist"]["twist"]["linear"]
        linear["x"], linear["y"] = (rotation(np.array(heading)) @ [linear["x"], linear["y"]]).tolist()
    path = bag(tmp_path, moves, detections(RECORDING))
    with pytest.raises(UserError, match=r"unless they are in the world's frame; give --set odometry.kind=poses"):
        read_bag(path)
    assert_same(read_bag(path, overrides=["odometry.kind=poses"]).recording, RECORDING)


def test_noise_that_messages_do_not_have_must_be_stated(tmp_path: Path):
    moves = odometry_messages(RECORDING)
    for *_, fields in moves:
        del fields["twist"]["covariance"]
    path = bag(tmp_path, moves, detections(RECORDING), kind="ros1")
    with pytest.raises(UserError, match=r"no variance of noise.forward; give --set noise.forward=SIGMA"):
        read_bag(path)
    found = read_bag(path, overrides=["noise.forward=0.2", "noise.turn=0.1", "noise.lateral=0.05"]).recording
    assert_allclose(found.odometry_cov, np.tile(np.diag([0.02, 0.005, 0.01]) ** 2, (found.steps, 1, 1)), atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_file_is_one_line_or_has_all_messages(kind: str, tmp_path: Path):
    path = bag(tmp_path, kind=kind)
    file = path if path.is_file() else next(each for each in path.iterdir() if each.name != "metadata.yaml")
    whole = file.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 40).astype(int).tolist():
        file.write_bytes(whole[:length])
        try:
            found = read_bag(path)
        except UserError as error:
            assert "\n" not in str(error)
        else:
            assert length > 0.9 * len(whole)  # the rest is not needed
            assert_same(found.recording, RECORDING)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_messages_is_one_line(kind: str, tmp_path: Path):
    path = Bags(kind).write(tmp_path / "run", [])
    with pytest.raises(UserError, match=r"^[^\n]*run[^\n]*topic[^\n]*$"):
        read_bag(path)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_folder_without_metadata_is_one_line(kind: str, tmp_path: Path):
    path = bag(tmp_path, kind=kind)
    (path / "metadata.yaml").unlink()
    with pytest.raises(UserError, match=r"run: cannot be read .*, or a ROS 2 folder with its metadata\.yaml"):
        read_bag(path)
    (file,) = path.iterdir()
    assert_same(read_bag(file).recording, RECORDING)


@pytest.mark.parametrize(
    ("override", "refusal"),
    [
        ("odometry.topic=/odon", "has no topic /odon; did you mean /odom?"),
        ("odometry.topic=/detections", "/detections has the type vision_msgs/msg/Detection3DArray"),
        ("observations.x=results.0.place", "a path does not fit its messages"),
        ("observations.covariance=results.0.pose.pose.position", "a path does not fit its messages"),
        ("observations.pattern=tag(", "observations.pattern: 'tag(': missing ), unterminated subpattern"),
        ("frames.base=wheel", "no static transform from base_link to wheel"),
        ("transforms.base_link=1", "transforms.base_link: input should be a valid array"),
    ],
)
def test_refusals(override: str, refusal: str, tmp_path: Path):
    with pytest.raises(UserError, match=re.escape(refusal)):
        read_bag(bag(tmp_path), overrides=[override])


def test_static_transforms_in_a_circle_are_refused(tmp_path: Path):
    step = {"translation": xyz(0.1, 0), "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    circle = [
        {"header": header(0.0, parent), "child_frame_id": child, "transform": step}
        for parent, child in (("camera", "base_link"), ("wheel", "camera"), ("camera", "wheel"))
    ]
    static = ("/tf_static", nanoseconds(1000.0), "tf2_msgs/msg/TFMessage", {"transforms": circle})
    path = bag(tmp_path, [static], odometry_messages(RECORDING), detections(RECORDING))
    with pytest.raises(UserError, match="no static transform from base_link to wheel"):
        read_bag(path, overrides=["frames.base=wheel"])


# --- commands -------------------------------------------------------------------------------------


def test_the_proposed_mapping_imports_the_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    moves, seen = odometry_messages(RECORDING), detections(RECORDING)
    truth = [
        ("/truth", time, kind, fields | {"header": fields["header"] | {"frame_id": "map"}})
        for _, time, kind, fields in moves
    ]
    path = bag(tmp_path, moves, seen, truth)
    assert run("import", "bag", path, "--list") == 0
    listed = capsys.readouterr().out
    assert re.search(rf"/detections +vision_msgs/msg/Detection3DArray +{len(seen)}\n", listed)
    mapping = tmp_path / "bag.toml"
    mapping.write_text(listed.partition("# proposed mapping\n")[2])
    assert run("import", "bag", path, "--mapping", mapping, "--out", tmp_path / "out") == 0
    assert_same(load_recording(tmp_path / "out/recording.npz"), RECORDING)
    stored = given(load_truth(tmp_path / "out/truth.npz").poses)
    assert_allclose(stored, chain(np.zeros(3), RECORDING.odometry), atol=1e-9)
    assert "agree with one place per landmark" in capsys.readouterr().err


def test_a_topic_as_an_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = bag(tmp_path, odometry_messages(RECORDING, "/ekf/odom"))
    estimate = load_stored(Path(f"{path}:/ekf/odom"), RECORDING).estimate
    assert_allclose(estimate.poses, chain(np.zeros(3), RECORDING.odometry), atol=1e-9)
    assert estimate.pose_covs is None  # they are 0 in the messages
    save(tmp_path / "recording.npz", RECORDING)
    command = ("evaluate", tmp_path / "recording.npz", "--estimators", "causal", "--estimates")
    assert run(*command, f"mine={path}:/ekf/odom") == 0
    assert "mine" in capsys.readouterr().out
    assert run(*command, f"mine={path}:/ekf/odo") == 1
    assert "has no topic /ekf/odo; did you mean /ekf/odom?" in capsys.readouterr().out
