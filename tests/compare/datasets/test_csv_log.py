"""CSV files of robots: the meaning of their columns, the rule for stamps, and one-line refusals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.storage.csv_folder import write_recording_csv
from slamgauge.compare.storage.files import load_recording, load_truth
from slamgauge.errors import UserError
from slamgauge.se2 import chain
from tests.reference.given import given
from tests.reference.random_recordings import recording_of
from tests.reference.robot_logs import CSV

NOISE = ("noise.forward=0.1", "noise.turn=0.05", "noise.range=0.2", "noise.bearing=0.03", "noise.position=0.3")
Log = Callable[..., Imported]
SEEN = "stamp,landmark,range,bearing\n0.5,7,2.0,0.1\n"


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """Writes files, and reads them as a log."""

    def read(files: dict[str, str], *overrides: str) -> Imported:
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return read_csv_log(tmp_path, overrides)

    return read


def odometry(text: str) -> dict[str, str]:
    return {"odometry.csv": text, "observations.csv": SEEN}


def observations(text: str) -> dict[str, str]:
    return {"odometry.csv": "stamp,x,y,theta\n0,0,0,0\n1,1,0,0\n2,2,0,0\n", "observations.csv": text}


def test_the_whole_log(log: Log, tmp_path: Path):
    recording, truth, notes, _ = log(CSV)
    with pytest.raises(UserError, match=r"odometry.csv: is neither a folder nor a .toml file; give the folder"):
        read_csv_log(tmp_path / "odometry.csv")
    assert_array_equal(recording.stamps, [0.0, 0.5, 1.0, 2.0, 3.0])
    assert_array_equal(recording.observation_step, [1, 1, 3])
    assert_array_equal(recording.landmark, [7, 3, 7])
    assert_allclose(recording.observation_cov[0], np.diag([0.04, 0.0009]))
    half_turn = 0.25  # rad, within the first half second, on a circle of 2 m
    arc = [2.0 * np.sin(half_turn), 2.0 * (1.0 - np.cos(half_turn)), half_turn]
    assert_allclose(recording.odometry[:2], [arc, arc], atol=1e-15)
    assert_allclose(recording.odometry_cov[0], np.diag([0.005, 0.0, 0.00125]))  # half of the row's
    assert_allclose(recording.odometry_cov[2], np.diag([0.01, 0.0, 0.0025]))
    assert_array_equal(recording.prior_mean, [0, 0, 3.0])
    assert_array_equal(recording.prior_cov, 0.0)
    assert truth is not None
    assert truth.poses is not None
    assert_array_equal(truth.landmark_ids, [3, 7])
    assert_array_equal(truth.association, [7, 3, 7])
    assert_allclose(truth.poses[1], [0.5, 0, np.pi])
    assert np.isnan(truth.poses[[3, 4]]).all()  # in a gap of 1.5 s, and beyond the end
    assert notes == ()


def test_increments_poses_and_velocities_of_one_drive_agree(log: Log):
    """Rows that describe the time before their stamp begin at start.stamp, or at the first row."""
    twists = np.array([[1.0, 0.2, 0.5], [0.5, 0.0, -0.4], [0.3, -0.1, 3.0]])
    stamps = np.array([0.0, 1.0, 2.0, 3.0])
    half = twists[:, 2] / 2
    c, s = np.cos(half), np.sin(half)
    chord = np.sinc(half / np.pi)[:, None] * np.column_stack(
        [c * twists[:, 0] - s * twists[:, 1], s * twists[:, 0] + c * twists[:, 1]]
    )
    moves = np.column_stack([chord, twists[:, 2]])

    def rows(header: str, table: np.ndarray) -> dict[str, str]:
        return odometry(f"{header}\n" + "".join(",".join(map(repr, row)) + "\n" for row in table.tolist()))

    padded = np.vstack([np.zeros(3), twists])
    shifted = np.vstack([twists, np.zeros(3)])
    found = [
        log(rows("stamp,dx,dy,dtheta", np.column_stack([stamps[1:], moves])), *NOISE, "start.stamp=0"),
        log(rows("stamp,dx,dy,dtheta", np.column_stack([stamps, np.vstack([np.zeros(3), moves])])), *NOISE),
        log(rows("stamp,v,vy,omega", np.column_stack([stamps, shifted])), *NOISE),
        log(rows("stamp,v,vy,omega", np.column_stack([stamps, padded])), *NOISE, "odometry.holds=since-last"),
        log(rows("stamp,x,y,theta", np.column_stack([stamps, chain(np.array([4.0, 5.0, 6.0]), moves)])), *NOISE),
    ]
    for each in found:
        assert_allclose(each.recording.odometry, found[0].recording.odometry, atol=1e-14)
        assert_array_equal(each.recording.stamps, [0.0, 0.5, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(("per", "growth"), [("step", 1.0), ("second", 0.25), ("speed", 0.0625)])
def test_noise_of_motions_and_of_the_start(log: Log, per: str, growth: float):
    files = odometry("stamp,v,omega\n0,1,0\n0.5,1,0\n0.75,0,0\n")
    start = ("start.pose=[1, 2, 3]", "start.sigmas=[0.1,0,0]")
    recording = log(files, *NOISE, f"noise.per={per}", "noise.lateral=0.02", *start).recording
    assert_array_equal(recording.prior_mean, [1, 2, 3])
    assert_allclose(recording.prior_cov, np.diag([0.01, 0, 0]))
    assert_allclose(recording.odometry_cov[1], growth * np.diag([0.1, 0.02, 0.05]) ** 2, rtol=1e-12)


def test_positions_and_missing_ids(log: Log):
    recording = log(observations("stamp,x,y\n1,3,4\n2,5,6\n"), *NOISE).recording
    assert recording.sensor == "position"
    assert recording.landmark is None
    assert_array_equal(recording.observation, [[3, 4], [5, 6]])
    assert_allclose(recording.observation_cov[0], 0.09 * np.eye(2))


def test_observations_without_an_id_or_a_range_or_outside_the_odometry_are_dropped(log: Log):
    text = "stamp,landmark,range,bearing\n-1,7,1,0\n0,-1,1,0\n1,7,1,0\n1,8,0,0\n2,7,1,0\n5,7,1,0\n"
    recording, _, notes, _ = log(observations(text), *NOISE, "observations.drop_zero_ranges=true")
    assert_array_equal(recording.observation_step, [1, 2])
    assert notes == (
        "1 observations have range 0 m (no detection?), the first in line 5; they are left out",
        "1 of 5 observations have no id and are dropped",
        "2 observations outside the odometry's time are dropped, 50%: check units and clocks of the files",
    )


DRIVE = "stamp,v,omega\n0,1,0\n1,1,0\n"


@pytest.mark.parametrize(
    ("files", "override", "message"),
    [
        (
            odometry("stamp,v,omega\n0,1,90\n1,1,0\n"),
            "",
            "line 2: the robot turns by 90 rad in one row; check the unit",
        ),
        (odometry("stamp,v,omega\n0,1,0\n"), "", "odometry.csv: fewer than two stamps"),
        (
            odometry("when,v,omega\n0,1,0\n"),
            "",
            "line 1: no column stamp; name the file's own in columns: stamp = NAME",
        ),
        (odometry("stamp,x,y,theta,v,omega\n0,1,0,0,0,0\n"), "", "could be velocities or poses; give the kind with"),
        (odometry("stamp,v,omega,v_std\n0,1,0,-1\n1,1,0,1\n"), "", "line 2: v_std is negative"),
        (odometry(DRIVE), "start.stamp=0", "odometry.csv: start.stamp: the log starts at the first row of velocities"),
        (
            odometry("stamp,dx,dtheta\n1700000007.9,1,0\n1700000008.9,1,0\n"),
            "start.stamp=1700000007.95",
            "line 2: is not after the start at 1700000007.95 s",
        ),
        (odometry(DRIVE), "noise.forward=-1", "noise.forward: input should be greater than or equal to 0, not '-1'"),
        (odometry(DRIVE), "noise.fwd=1", "noise.fwd: unknown key; did you mean forward?"),
        (odometry(DRIVE), "nose.forward=1", "nose: unknown section; did you mean noise?"),
        (odometry(DRIVE), "noise.per=metre", "noise.per: input should be 'step', 'second' or 'speed', not 'metre'"),
        (odometry(DRIVE), "truth.file=none.csv", "none.csv: cannot be read"),
        (odometry("step,stamp,dx,dtheta\n1,1,1,0\n3,2,1,0\n"), "", "line 1: the steps are not 1, 2, 3, ..."),
        (odometry(DRIVE) | {"start.csv": "stamp,x,y,theta\n0,0,0,0\n1,0,0,0\n"}, "", "has 2 rows; write one"),
        (observations("step,range,bearing\n0,1,1\n0.5,1,1\n"), "", "observation_step[1] = 0.5"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(log: Log, files: dict[str, str], override: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        log(files, *NOISE, *filter(None, [override]))
    assert message in str(caught.value)


@pytest.mark.parametrize(("stated", "file"), [(NOISE[:0], "odometry"), (NOISE[:2], "observations")])
def test_noise_must_be_stated(log: Log, stated: tuple[str, ...], file: str):
    missing = rf"{file}\.csv: its rows have no noise, and noise\.(forward|range) is missing; give --set noise\."
    with pytest.raises(UserError, match=missing):
        log(odometry(DRIVE), *stated)


def test_the_stored_mapping_reads_the_same_log_again(tmp_path: Path):
    for name, text in CSV.items():
        (tmp_path / name).write_text(text)
    first, again = tmp_path / "first", tmp_path / "again"
    assert main(["import", "csv", str(tmp_path), "--set", "noise.lateral=0.01", "--out", str(first)]) == 0
    assert main(["import", "csv", str(first / "recording.toml"), "--out", str(again)]) == 0
    assert load_recording(first / "recording.npz") == load_recording(again / "recording.npz")
    assert load_truth(first / "truth.npz") == load_truth(again / "truth.npz")


@pytest.mark.parametrize("sensor", ["range-bearing", "bearing", "position"])
def test_csv_folders_are_read_back_bit_for_bit(sensor: str, tmp_path: Path):
    recording = recording_of(sensor, slip=False)
    write_recording_csv(tmp_path, recording)
    assert read_csv_log(tmp_path).recording == recording


@pytest.mark.parametrize(
    ("header", "first", "second", "sigmas"),
    [
        ("stamp,v,omega,v_std,omega_sigma", "0,1,0,0.2,0.4", "0.5,1,0,0.2,0.4", [0.1, 0.0, 0.2]),
        ("stamp,dx,dtheta,dx_std", "0,0,0,1", "0.5,1,0,0.2", [0.2, 0.0, 0.05]),
        (
            "stamp,dx,dy,dtheta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt",
            "0,0,0,0,1,0,0,1,0,1",
            "0.5,1,0,0,4,0,0,9,0,1",
            [2, 3, 1],
        ),
    ],
)
def test_noise_of_rows(log: Log, header: str, first: str, second: str, sigmas: list[float]):
    recording = log(odometry(f"{header}\n{first}\n{second}\n"), *NOISE).recording
    assert_allclose(recording.odometry_cov[0], np.diag(sigmas) ** 2, atol=1e-15)


def test_texts_are_ids_and_their_numbers_can_be_stated(log: Log):
    files = observations("stamp,id,x,y\n0,oak,1,0\n1,7,2,0\n2,elm,3,1\n")
    files["landmarks.csv"] = "id,x,y\nelm,0,1\noak,1,0\n7,2,0\n"
    found = log(files, *NOISE)
    assert_array_equal(found.recording.landmark, [9, 7, 8])
    assert_array_equal(given(found.truth).landmark_ids, [8, 9, 7])
    assert found.notes == ("ids are texts, numbered from 8: elm, oak",)
    assert_array_equal(log(files, *NOISE, "ids.elm=1", "ids.oak=2").recording.landmark, [2, 7, 1])
    with pytest.raises(UserError, match=r"the id 'oak' has no number; add it to \[ids\]"):
        log(files, *NOISE, "ids.elm=1")


def test_a_truth_without_headings_has_positions(log: Log):
    files = odometry("stamp,v,omega\n0,1,0\n1,1,0\n2,1,0\n") | {"truth.csv": "stamp,x,y\n0,3,0\n1,3,1\n2,3,2\n"}
    found = log(files, *NOISE)
    poses = given(given(found.truth).poses)
    assert_allclose(poses[[0, -1], :2], [[3, 0], [3, 2]])
    assert np.isnan(poses[:, 2]).all()
    assert_array_equal(found.recording.prior_mean, [3, 0, 0])
    assert "has the heading 0; state its own with --set start.pose=[3,0,HEADING]" in found.notes[-1]
