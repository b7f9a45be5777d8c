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
from slamgauge.compare.storage.csv_folder import read_recording_csv, write_recording_csv
from slamgauge.compare.storage.files import load_recording, load_truth, save
from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch
from slamgauge.se2 import chain
from tests.reference.random_recordings import random_recording, recording_of
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


def test_the_whole_log(log: Log):
    recording, truth, notes, _, unmatched = log(CSV)
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
    assert unmatched == 0


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
def test_noise_of_motions(log: Log, per: str, growth: float):
    files = odometry("stamp,v,omega\n0,1,0\n0.5,1,0\n0.75,0,0\n")
    recording = log(files, *NOISE, f"noise.per={per}", "noise.lateral=0.02").recording
    assert_allclose(recording.odometry_cov[1], growth * np.diag([0.1, 0.02, 0.05]) ** 2, rtol=1e-12)


def test_columns_and_units_of_the_log(log: Log):
    files = {
        "odometry.csv": '"t";"speed";"note";"rate"\n1000;500;"a, b";90\n2000;0;x;0\n',
        "observations.csv": "# milliseconds\n",
        "laser.csv": "1000 4 -90\n1500 5 270\n",
    }
    own = (
        'odometry.columns={stamp="t", v="speed", omega="rate"}',
        *("odometry.time=ms", "odometry.length=mm", "odometry.angle=deg"),
        *("observations.file=laser.csv", "observations.kind=bearing", "observations.time=ms", "observations.angle=deg"),
    )
    recording = log(files, *NOISE, *own).recording
    assert_array_equal(recording.stamps, [1.0, 1.5, 2.0])
    assert_allclose(recording.odometry[:, 2], np.pi / 4)
    assert_allclose(np.hypot(*recording.odometry[0, :2]), 2 * (0.5 / (np.pi / 2)) * np.sin(np.pi / 8))
    assert recording.sensor == "bearing"
    assert_allclose(recording.observation[:, 0], [-np.pi / 2, -np.pi / 2])
    assert_array_equal(recording.landmark, [4, 5])


@pytest.mark.parametrize(
    "text", ["%stamp,v,omega\n0,1,0\n1,1,0\n", "# a robot, mine\n\nstamp;v;omega\n0;1;0\n# a remark\n1;1;0\n"]
)
def test_remarks_and_headers_behind_a_sign(log: Log, text: str):
    assert_array_equal(log(odometry(text), *NOISE).recording.stamps, [0.0, 0.5, 1.0])


def test_positions_and_missing_ids(log: Log):
    recording = log(observations("stamp,x,y\n1,3,4\n2,5,6\n"), *NOISE).recording
    assert recording.sensor == "position"
    assert recording.landmark is None
    assert_array_equal(recording.observation, [[3, 4], [5, 6]])
    assert_allclose(recording.observation_cov[0], 0.09 * np.eye(2))


def test_observations_without_an_id_or_outside_the_odometry_are_dropped(log: Log):
    text = "stamp,landmark,range,bearing\n-1,7,1,0\n0,-1,1,0\n1,7,1,0\n2,7,1,0\n5,7,1,0\n"
    recording, _, notes, _, unmatched = log(observations(text), *NOISE)
    assert_array_equal(recording.observation_step, [1, 2])
    assert notes == (
        "1 of 5 observations have no id and are dropped",
        "2 observations outside the odometry's time are dropped, 50%: check units and clocks of the files",
    )
    assert unmatched == 2


def test_the_start_can_be_stated(log: Log):
    start = ("start.pose=[1, 2, 3]", "start.sigmas=[0.1,0,0]")
    recording = log(odometry("stamp,v,omega\n0,1,0\n1,1,0\n"), *NOISE, *start).recording
    assert_array_equal(recording.prior_mean, [1, 2, 3])
    assert_allclose(recording.prior_cov, np.diag([0.01, 0, 0]))


DRIVE = "stamp,v,omega\n0,1,0\n1,1,0\n"


@pytest.mark.parametrize(
    ("files", "override", "message"),
    [
        (
            odometry("stamp,v,omega\n0,1,0\n0,1,0\n"),
            "",
            "odometry.csv, line 3: stamp 0.000000000 is that of the line above",
        ),
        (odometry("stamp,v,omega\n0,1,0\n1,nan,0\n"), "", "odometry.csv, line 3: 'nan' is not a finite number"),
        (odometry("stamp,v,omega\n0,1,0\n1,1\n"), "", "odometry.csv, line 3: has 2 columns where the first line has 3"),
        (
            odometry("stamp,v,omega\n0,1,90\n1,1,0\n"),
            "",
            "line 2: the robot turns by 90 rad in one row; check the unit",
        ),
        (odometry("stamp,v,omega\n0,1,0\n"), "", "odometry.csv: fewer than two stamps"),
        (
            odometry("when,v,omega\n0,1,0\n"),
            "",
            "line 1: does not have the columns stamp,dx,dy,dtheta or stamp,v,vy,omega",
        ),
        (odometry("stamp,x,y,theta,v,omega\n0,1,0,0,0,0\n"), "", "could be velocities or poses; give the kind with"),
        (odometry("0,1,0\n1,1,0\n"), "", "line 1: no header, and odometry.kind is not given"),
        (odometry(DRIVE), "start.stamp=0", "start.stamp: the log starts at the first row of velocities"),
        (observations("stamp,landmark,range,bearing\n1,2.5,1,0\n"), "", "observations.csv, line 2: '2.5' is not an id"),
        (observations("stamp,landmark,range,bearing\n1,2,-1,0\n"), "", "line 2: the range is negative"),
        (observations("stamp,landmark,range,bearing\n1,2,1,0\n0,2,1,0\n"), "", "observations.csv, line 3: stamp"),
        (odometry(DRIVE), "noise.forward=-1", "noise.forward: -1 is not a standard deviation"),
        (odometry(DRIVE), "noise.fwd=1", "noise.fwd: unknown key; did you mean forward?"),
        (odometry(DRIVE), "nose.forward=1", "nose: unknown section; did you mean noise?"),
        (odometry(DRIVE), "noise.per=metre", "noise.per: must be one of step, second, speed"),
        (odometry(DRIVE), "odometry.columns={w=1}", "odometry.columns.w: unknown column"),
        (odometry(DRIVE), "truth.file=none.csv", "none.csv: cannot be read"),
    ],
)
def test_wrong_logs_are_refused_in_one_line(log: Log, files: dict[str, str], override: str, message: str):
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        log(files, *NOISE, *filter(None, [override]))
    assert message in str(caught.value)


def test_a_single_csv_file_is_no_log(tmp_path: Path):
    (tmp_path / "odometry.csv").write_text("stamp,v,omega\n")
    with pytest.raises(UserError, match=r"odometry.csv: is neither a folder nor a .toml file; give the folder"):
        read_csv_log(tmp_path / "odometry.csv")


def test_noise_must_be_stated(log: Log):
    with pytest.raises(UserError, match=r"recording.toml: noise.forward: missing; add it, or give --set noise.forward"):
        log(odometry(DRIVE))


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
    assert read_recording_csv(tmp_path) == recording
    assert read_csv_log(tmp_path).recording == recording
    with pytest.raises(UserError, match=r"start.csv states everything"):
        read_csv_log(tmp_path, ["noise.forward=1"])


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("start.csv", "\n", "\n0,0,0,0,0,0,0,0,0,0\n", "start.csv: has 2 rows; write one, the prior"),
        ("odometry.csv", "\n2,", "\n3,", "odometry.csv, line 3: step 3, expected 2"),
        (
            "observations.csv",
            "range",
            "reach",
            "observations.csv: line 1 is not the header of this file; write step,landmark",
        ),
        ("observations.csv", "\n0,2,", "\n0,-1,", "observations.csv, line 2: only some ids are -1"),
        ("observations.csv", "\n0,", "\n0.5,", "step[0] = 0.5: every entry must be a whole number"),
    ],
)
def test_damaged_csv_folders_are_refused(tmp_path: Path, name: str, old: str, new: str, message: str):
    write_recording_csv(tmp_path, random_recording(5)[1])
    text = (tmp_path / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new, 1))
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        read_recording_csv(tmp_path)
    assert message in str(caught.value)


def test_csv_to_npz_to_csv_keeps_the_cost_of_batch(tmp_path: Path):
    _, recording = random_recording(4)
    save(tmp_path / "recording.npz", recording)
    there, back = tmp_path / "csv", tmp_path / "npz"
    assert main(["export", "csv", str(tmp_path / "recording.npz"), "--out", str(there)]) == 0
    assert main(["import", "csv", str(there), "--out", str(back)]) == 0
    cost, expected = (batch(each).chi_square for each in (load_recording(back / "recording.npz"), recording))
    assert cost == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("end", ["\n", "\n\n", "\r\n \n\t\n"])
def test_blank_lines_at_the_end_change_nothing(log: Log, end: str, tmp_path: Path):
    whole = log(CSV).recording
    assert log({name: text + end if name.endswith(".csv") else text for name, text in CSV.items()}).recording == whole
    own = tmp_path / "own"
    own.mkdir()
    write_recording_csv(own, whole)
    for path in own.iterdir():
        path.write_text(path.read_text() + end)
    assert read_recording_csv(own) == whole


def test_a_blank_line_between_rows_of_a_folder_of_ours_is_refused(tmp_path: Path):
    write_recording_csv(tmp_path, random_recording(1)[1])
    path = tmp_path / "odometry.csv"
    path.write_text(path.read_text().replace("\n2,", "\n\n2,"))
    with pytest.raises(UserError, match=r"odometry.csv, line 3: '' has a value that is not a number"):
        read_recording_csv(tmp_path)
