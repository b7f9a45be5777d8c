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


def simulated(sensor: str = "position", start: float = 1000.0, **more: Any) -> Recording:
    _, recording = random_recording(4, sensor=sensor, **more)
    return replace(recording, stamps=start + recording.stamps, prior_mean=np.zeros(3), prior_cov=np.zeros((3, 3)))


def detections(recording: Recording, topic: str = "/detections"):
    return scan_messages(recording, topic, "vision_msgs/msg/Detection3DArray", detection, "detections")


def bag_of(recording: Recording, folder: Path, kind: str = "mcap", **options: bool) -> Path:
    """Write a bag of the odometry and of detections."""
    return Bags(kind, **options).write(folder / "run", in_order(odometry_messages(recording), detections(recording)))


def with_noise(recording: Recording) -> Recording:
    """Return a recording with the noise of `noise.position=0.3`."""
    return replace(recording, observation_cov=np.tile(np.eye(2) * 0.3**2, (len(recording.observation), 1, 1)))


def assert_same(found: Recording, written: Recording) -> None:
    assert_allclose(found.stamps, written.stamps, rtol=0, atol=1e-6)
    for name in ("odometry", "odometry_cov", "observation", "observation_cov"):
        assert_allclose(getattr(found, name), getattr(written, name), rtol=0, atol=1e-9, err_msg=name)
    assert_array_equal(found.observation_step, written.observation_step)
    assert_array_equal(found.landmark, written.landmark)
    assert found.sensor == written.sensor


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("start", "compressed"), [(0.0, False), (1000.0, False), (1.7e9, False), (1000.0, True)])
def test_detections_with_twists(kind: str, start: float, compressed: bool, tmp_path: Path):
    recording = simulated(start=start)
    found = read_bag(bag_of(recording, tmp_path, kind, compressed=compressed))
    assert_same(found.recording, recording)
    assert found.notes == ()


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_type_of_ones_own_with_poses(kind: str, tmp_path: Path):
    recording = simulated("range-bearing")
    scans = scan_messages(recording, "/scan", "robot_msgs/msg/Scan", own_scan, "landmarks")
    path = Bags(kind).write(tmp_path / "run", in_order(odometry_messages(recording), scans))
    found = read_bag(path, overrides=[*OWN, "odometry.kind=poses"])
    assert_same(found.recording, recording)


# --- shipped mappings -----------------------------------------------------------------------------


def point(name: str, key: str, more: dict[str, Any] | None = None) -> Element:
    """Return a function that makes elements with an id and a position at a path."""

    def make(number: int, value: Float, _cov: Float) -> dict[str, Any]:
        element: Any = xyz(*value)
        for each in reversed(key.split(".")):
            element = {each: element}
        return element | ({name: number} if name else {}) | (more or {})

    return make


def tag(number: int, value: Float, cov: Float) -> dict[str, Any]:
    whole = np.zeros((3, 3))
    whole[:2, :2] = cov
    pose = {"pose": {"position": xyz(*value)}, "covariance": six(whole)}
    return {"id": [number], "pose": {"header": header(0.0), "pose": pose}}


def cone(_number: int, value: Float, cov: Float) -> dict[str, Any]:
    return {"point": xyz(*value), "covariance": cov.ravel()}


@pytest.mark.parametrize(
    ("kind", "array", "element", "states_noise"),
    [
        ("vision_msgs/msg/Detection3DArray", "detections", detection, False),
        ("apriltag_ros/msg/AprilTagDetectionArray", "detections", tag, False),
        ("fiducial_msgs/msg/FiducialTransformArray", "transforms", point("fiducial_id", "transform.translation"), True),
        ("eufs_msgs/msg/ConeArrayWithCovariance", "yellow_cones", cone, False),
    ],
)
def test_known_types(kind: str, array: str, element: Element, states_noise: bool, tmp_path: Path):
    recording = simulated()
    if states_noise:
        recording = with_noise(recording)
    if "Cone" in kind:
        recording = replace(recording, landmark=None)
    scans = scan_messages(recording, "/seen", kind, element, array)
    path = Bags("ros1").write(tmp_path / "run", in_order(odometry_messages(recording), scans))
    found = read_bag(path, overrides=["noise.position=0.3"] if states_noise else [])
    assert_same(found.recording, recording)


def test_markers_that_are_deleted_are_no_observations(tmp_path: Path):
    """The stamps and frames of an array without a header are those of its markers."""
    recording = simulated()
    messages = list[Message]()
    for topic, received, _, fields in detections(recording):
        own = {"header": fields["header"], "type": 2}
        there = [
            own | {"id": int(each["id"]), "pose": {"position": each["results"][0]["pose"]["pose"]["position"]}}
            for each in fields["detections"]
        ]
        gone = own | {"id": 99, "action": 2}
        messages.append((topic, received, "visualization_msgs/msg/MarkerArray", {"markers": [*there, gone]}))
    path = Bags("mcap").write(tmp_path / "run", in_order(odometry_messages(recording), messages))
    assert_same(read_bag(path, overrides=["noise.position=0.3"]).recording, with_noise(recording))


def test_tags_of_apriltag_ros_on_tf(tmp_path: Path):
    """Transforms of other frames are dropped, and a camera's axes are turned into the robot's by static transforms."""
    recording = simulated()
    camera = {"translation": xyz(0.3, 0.1, 0.5), "rotation": {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}}  # optical
    static: Message = (
        "/tf_static",
        nanoseconds(1000.0),
        "tf2_msgs/msg/TFMessage",
        {"transforms": [{"header": header(0.0, "base_link"), "child_frame_id": "camera", "transform": camera}]},
    )
    messages = list[Message]()
    for _, received, _, fields in detections(recording):
        own = {"header": fields["header"] | {"frame_id": "camera"}}
        there = [own | {"child_frame_id": "tag36h11:none", "transform": {"translation": xyz(9, 9)}}]
        for each in fields["detections"]:
            position = each["results"][0]["pose"]["pose"]["position"]
            ahead, left = position["x"] - 0.3, position["y"] - 0.1
            there.append(
                own | {"child_frame_id": f"tag36h11:{each['id']}", "transform": {"translation": xyz(-left, 0.5, ahead)}}
            )
        messages.append(("/tf", received, "tf2_msgs/msg/TFMessage", {"transforms": there}))
    path = Bags("sqlite3").write(tmp_path / "run", [static, *in_order(odometry_messages(recording), messages)])
    found = read_bag(path, overrides=["noise.position=0.3", "observations.topic=/tf"]).recording
    assert_same(found, with_noise(recording))


def test_ranges_and_bearings_of_a_mounted_laser(tmp_path: Path):
    recording = simulated("range-bearing")
    scans = scan_messages(recording, "/scan", "robot_msgs/msg/Scan", own_scan, "landmarks")
    for _, _, _, fields in scans:
        fields["header"]["frame_id"] = "laser"
    path = Bags("mcap").write(tmp_path / "run", in_order(odometry_messages(recording), scans))
    mount = np.array([0.4, -0.1, np.pi / 2])
    found = read_bag(path, overrides=[*OWN, f"transforms.laser={mount.tolist()}"]).recording

    def landmarks(of: Recording, sensor: Float) -> Float:
        return compose(sensor, np.column_stack([inverse(of.sensor, of.observation), np.zeros(len(of.observation))]))

    assert_allclose(landmarks(found, np.zeros(3))[:, :2], landmarks(recording, mount)[:, :2], atol=1e-12)
    in_plane = [
        np.einsum("nij,njk,nlk->nil", B, of.observation_cov, B)
        for of in (recording, found)
        for B in [inverse_jacobian(of.sensor, of.observation)]
    ]
    turn = rotation(mount[2])
    assert_allclose(in_plane[1], turn @ in_plane[0] @ turn.T, atol=1e-12)


# --- logs with faults -----------------------------------------------------------------------------


def test_late_and_repeated_messages_change_nothing(tmp_path: Path):
    recording = simulated()
    moves, seen = odometry_messages(recording), detections(recording)
    moves[3], moves[4] = moves[4], moves[3]  # in the order of writing
    received = [message[1] for message in odometry_messages(recording)]
    moves = [(topic, time, kind, fields) for time, (topic, _, kind, fields) in zip(received, moves, strict=True)]
    latched = [(topic, time + 5, kind, fields) for topic, time, kind, fields in seen[:4]]
    path = Bags("ros1").write(tmp_path / "run", in_order(moves, seen, latched))
    found = read_bag(path)
    assert_same(found.recording, recording)
    assert found.notes == ("/odom: 1 messages have a stamp before that of the message before them; sorted by stamps",)


def test_a_clock_that_jumps(tmp_path: Path):
    recording = simulated()
    moves = odometry_messages(recording)
    for topic, _, _, fields in moves[20:]:
        assert topic == "/odom"
        fields["header"]["stamp"]["sec"] += 3600
    path = Bags("mcap").write(tmp_path / "run", in_order(moves, detections(recording)))
    with pytest.raises(UserError, match=r"jumps by \+3600 s at stamp 4602.0\d* s; cut the bag there"):
        read_bag(path)
    assert_same(read_bag(path, overrides=["frames.clock=recording"]).recording, recording)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_file_is_one_line_or_has_all_messages(kind: str, tmp_path: Path):
    recording = simulated()
    path = bag_of(recording, tmp_path, kind)
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
            assert_same(found.recording, recording)


@pytest.mark.parametrize(
    ("overrides", "refusal"),
    [
        (["odometry.topic=/odon"], "has no topic /odon; did you mean /odom?"),
        (["odometry.topic=/detections"], "/detections has the type vision_msgs/msg/Detection3DArray"),
        (["truth.topic=/detections"], "truth.topic: /detections has the type"),
        (["observations.x=results.0.place"], "a path does not fit its messages"),
        (["observations.covariance=results.0.pose.pose.position"], "a path does not fit its messages"),
        (["noise.forward=-1"], "noise.forward: input should be greater than or equal to 0"),
        (["frames.base=wheel"], "no static transform from base_link to wheel"),
        (["transforms.base_link=1"], "transforms.base_link: input should be a valid array"),
        (["frames.clocks=header"], "frames.clocks: unknown key; did you mean clock?"),
    ],
)
def test_refusals(overrides: list[str], refusal: str, tmp_path: Path):
    recording = simulated()
    path = bag_of(recording, tmp_path)
    with pytest.raises(UserError, match=re.escape(refusal)):
        read_bag(path, overrides=overrides)


def test_noise_that_messages_do_not_have_must_be_stated(tmp_path: Path):
    recording = simulated()
    moves = odometry_messages(recording)
    for _, _, _, fields in moves:
        del fields["twist"]["covariance"]
    path = Bags("ros1").write(tmp_path / "run", in_order(moves, detections(recording)))
    with pytest.raises(UserError, match=r"no variance of noise.forward; give --set noise.forward=SIGMA"):
        read_bag(path)
    found = read_bag(path, overrides=["noise.forward=0.2", "noise.turn=0.1", "noise.lateral=0.05"]).recording
    expected = np.diag([0.02, 0.005, 0.01]) ** 2
    assert_allclose(found.odometry_cov, np.tile(expected, (recording.steps, 1, 1)), atol=1e-9)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    recording = simulated()
    truth = [
        ("/truth", time, kind, fields | {"header": fields["header"] | {"frame_id": "map"}})
        for _, time, kind, fields in odometry_messages(recording)
    ]
    path = Bags("mcap").write(tmp_path / "run", in_order(odometry_messages(recording), detections(recording), truth))
    assert run("import", "bag", path, "--list") == 0
    listed = capsys.readouterr().out
    assert re.search(rf"/detections +vision_msgs/msg/Detection3DArray +{len(detections(recording))}\n", listed)
    mapping = tmp_path / "bag.toml"
    mapping.write_text(listed.partition("# proposed mapping\n")[2])
    assert run("import", "bag", path, "--mapping", mapping, "--out", tmp_path / "out") == 0
    assert_same(load_recording(tmp_path / "out/recording.npz"), recording)
    stored = load_truth(tmp_path / "out/truth.npz")
    assert stored.poses is not None
    assert_allclose(stored.poses, chain(np.zeros(3), recording.odometry), atol=1e-9)
    assert "agree with one place per landmark" in capsys.readouterr().err


def test_a_topic_as_an_estimate(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    recording = simulated()
    bag = Bags("mcap").write(tmp_path / "run", odometry_messages(recording, "/ekf/odom"))
    estimate = load_stored(Path(f"{bag}:/ekf/odom"), recording).estimate
    assert_allclose(estimate.poses, chain(np.zeros(3), recording.odometry), atol=1e-9)
    assert estimate.pose_covs is None  # they are 0 in the messages
    save(tmp_path / "recording.npz", recording)
    command = ("evaluate", tmp_path / "recording.npz", "--estimators", "causal", "--estimates", f"mine={bag}:/ekf/odom")
    assert run(*command) == 0
    assert "mine" in capsys.readouterr().out
    assert run(*command[:-1], f"mine={bag}:/ekf/odo") == 1
    assert "has no topic /ekf/odo; did you mean /ekf/odom?" in capsys.readouterr().out


def test_twists_in_the_frame_of_the_world_contradict_the_poses(tmp_path: Path):
    recording = simulated()
    moves = odometry_messages(recording)
    headings = chain(np.zeros(3), recording.odometry)[:, 2]
    for (*_, fields), heading in zip(moves, headings, strict=True):
        linear = fields["twist"]["twist"]["linear"]
        linear["x"], linear["y"] = (rotation(np.array(heading)) @ [linear["x"], linear["y"]]).tolist()
    path = Bags("mcap").write(tmp_path / "run", in_order(moves, detections(recording)))
    with pytest.raises(UserError, match=r"unless they are in the world's frame; give --set odometry.kind=poses"):
        read_bag(path)
    assert_same(read_bag(path, overrides=["odometry.kind=poses"]).recording, recording)


# --- bags as robots write them -------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_messages_is_one_line(kind: str, tmp_path: Path):
    path = Bags(kind).write(tmp_path / "run", [])
    with pytest.raises(UserError, match=r"run.*topic") as caught:
        read_bag(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_folder_without_metadata_is_one_line(kind: str, tmp_path: Path):
    recording = simulated()
    path = bag_of(recording, tmp_path, kind)
    (path / "metadata.yaml").unlink()
    with pytest.raises(
        UserError, match=r"run: cannot be read .*; give a .*, or a ROS 2 folder with its metadata\.yaml"
    ):
        read_bag(path)
    (file,) = path.iterdir()
    assert_same(read_bag(file).recording, recording)


@pytest.mark.parametrize("kind", KINDS)
def test_without_stamps_in_headers_the_times_of_recording_are_used(kind: str, tmp_path: Path):
    recording = simulated()
    messages = in_order(odometry_messages(recording), detections(recording))
    for *_, fields in messages:
        fields["header"] = header(0.0, fields["header"]["frame_id"])
    found = read_bag(Bags(kind).write(tmp_path / "run", messages))
    assert "/odom: no stamps in its headers; times of recording are used" in " ".join(found.notes)
    assert_same(found.recording, recording)
