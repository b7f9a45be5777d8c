"""Stored trajectories: each variant of a file is read as it was meant, or refused or doubted in a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.arrays import Float
from slamgauge.compare.datasets.plausibility import path_doubts
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.csv_folder import POSE, write_rows
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain

STEPS, READ = 60, "read"
MOVES = np.column_stack([np.full(STEPS, 0.5), np.zeros(STEPS), np.where(np.arange(STEPS) < 40, 0.12, -0.08)])
RECORDING = Recording(
    stamps=1e9 + 0.1 * np.arange(STEPS + 1.0),
    prior_mean=np.zeros(3),
    prior_cov=np.zeros((3, 3)),
    odometry=MOVES,
    odometry_cov=np.diag([1e-4, 1e-6, 1e-5]),
    sensor="bearing",
    observation_step=np.zeros(0, np.int64),
    observation=np.zeros((0, 1)),
    observation_cov=np.zeros((0, 1, 1)),
    landmark=None,
)
NOISE = np.cumsum(np.random.default_rng(4).normal(0.0, [0.01, 0.01, 0.002], (STEPS + 1, 3)), axis=0)
POSES = chain(np.zeros(3), MOVES) + NOISE
ESTIMATE = Estimate("filtered", POSES, np.linspace(1.0, 2.0, STEPS + 1)[:, None, None] * np.diag([0.1, 0.2, 0.01]))
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
Table = Callable[[Float, Float], Float]  # rows of a file from stamps and poses
Text = Callable[[str], str]


def tum(stamps: Float, poses: Float) -> Float:
    x, y, heading = poses.T
    zero = np.zeros_like(x)
    return np.column_stack([stamps, x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)])


def numbered(_: Float, poses: Float) -> Float:
    return np.column_stack([np.arange(len(poses), dtype=np.float64), poses])


def stamped(stamps: Float, poses: Float) -> Float:
    return np.column_stack([stamps, poses])


def scaled(form: Table, *factors: float) -> Table:
    return lambda stamps, poses: form(stamps, poses * factors)


def columns(*order: int) -> Table:
    return lambda stamps, poses: tum(stamps, poses)[:, order]


def changed(form: Table, change: Callable[[Float], Float]) -> Table:
    return lambda stamps, poses: change(form(stamps, poses))


def times(*factors: float) -> Table:
    return changed(tum, lambda rows: rows * [1, 1, 1, 1, *factors])


def rounded(digits: int) -> Table:
    return changed(tum, lambda rows: np.column_stack([np.round(rows[:, 0], digits), rows[:, 1:]]))


def turned(poses: Float) -> Float:
    return np.column_stack([poses[:, :2] @ TURN.T, poses[:, 2] + np.pi / 2])


def replaced(old: str, new: str) -> Text:
    return lambda text: text.replace(old, new)


def headed(line: str) -> Text:
    return lambda text: line + text


TURNS, DISTANCES = "times the turns of the odometry", "times the distances of the odometry"
TUM: dict[str, tuple[Table, Text | None, str]] = {  # its rows, change of its text, what must happen
    "as it is": (tum, None, READ),
    "any order of lines": (changed(tum, lambda rows: rows[::-1]), None, READ),
    "quaternions negated": (times(-1, -1, -1, -1), None, READ),
    "commas": (tum, replaced(" ", ","), READ),
    "tabs": (tum, replaced(" ", "\t"), READ),
    "byte order mark": (tum, headed("\ufeff"), READ),
    "header behind #": (tum, headed("# t x y z qx qy qz qw\n"), READ),
    "blank lines and Windows": (tum, lambda text: text.replace("\n", "\r\n") + "\r\n\r\n", READ),
    "a height": (changed(tum, lambda rows: np.add(rows, [0, 0, 0, 5, 0, 0, 0, 0])), None, READ),
    "CR only": (tum, replaced("\n", "\r"), READ),
    "stamps of 10 ms": (rounded(2), None, READ),
    "each line twice": (changed(tum, lambda rows: np.repeat(rows, 2, axis=0)), None, READ),
    "a header without #": (tum, headed("t x y z qx qy qz qw\n"), "line 1"),
    "wxyz": (columns(0, 1, 2, 3, 7, 4, 5, 6), None, "the columns are not in the order qx qy qz qw"),
    "norm 2": (times(2, 2, 2, 2), None, "line 1: the quaternion qx qy qz qw has the length 2; write unit quaternions"),
    "norm 0": (times(0, 0, 0, 0), None, "has the length 0"),
    "no rotation": (scaled(tum, 1, 1, 0), None, TURNS),
    "millimetres": (scaled(tum, 1e3, 1e3, 1), None, DISTANCES),
    "clockwise": (scaled(tum, 1, 1, -1), None, TURNS),
    "mirrored": (scaled(tum, 1, -1, -1), None, TURNS),
    "x and y exchanged": (columns(0, 2, 1, 3, 4, 5, 6, 7), None, "times the distances"),
    "another frame": (lambda t, poses: tum(t, turned(poses)), None, "far from the prior"),
    "another clock": (lambda t, poses: tum(t - 1e9, poses), None, "no pose within 1 s of step 0"),
    "stamps in whole seconds": (rounded(0), None, "poses have the stamp of the pose before, and another"),
    "infinite": (tum, replaced("1000000000.9", "inf"), "line 10, column 1: 'inf' is not a finite"),
    "too large": (tum, replaced(" 0.0 0.0 0.0 ", " 1e200 0.0 0.0 "), "line 1, column 4: '1e200' is not a finite"),
    "two seconds missing": (
        changed(tum, lambda rows: np.delete(rows, slice(20, 40), axis=0)),
        None,
        "no pose within 1 s of step 20 at t = 1000000002.0",
    ),
    "one line missing": (changed(tum, lambda rows: np.delete(rows, 7, axis=0)), None, "60 poses are compared"),
    "no line": (tum, lambda _: "", "no line in it; write lines of t x y z qx qy qz qw"),
    "seven columns": (columns(0, 1, 2, 3, 4, 5, 6), None, "line 1: has 7 words, not 8; write t x y z qx qy qz qw"),
    "the last number cut short": (tum, lambda text: text[:-5], "no line end after"),
}
CSV: dict[str, tuple[Table, Text | None, str]] = {
    "as it is": (numbered, None, READ),
    "headings not wrapped": (changed(numbered, lambda rows: np.add(rows, [0, 0, 0, 4 * np.pi])), None, READ),
    "blank lines at the end": (numbered, lambda text: text + "\n\n", READ),
    "byte order mark": (numbered, headed("\ufeff"), READ),
    "stamps": (stamped, replaced("step", "stamp"), READ),
    "times": (stamped, replaced("step", "time"), READ),
    "semicolons": (numbered, replaced(",", ";"), READ),
    "the last number cut short": (numbered, lambda text: text[:-5], "no line end after"),
    "degrees": (scaled(numbered, 1, 1, 180 / np.pi), None, TURNS),
    "millimetres": (scaled(numbered, 1e3, 1e3, 1), None, DISTANCES),
    "no header": (numbered, lambda text: text.split("\n", 1)[1], "is not the header"),
    "other order": (numbered, replaced("x,y", "y,x"), "is not the header"),
    "from step 1": (changed(numbered, lambda rows: rows[1:]), None, "step 1, expected 0"),
    "a step missing": (changed(numbered, lambda rows: np.delete(rows, 7, axis=0)), None, "expected 7"),
    "nan": (changed(numbered, lambda rows: np.add(rows, [0, np.nan, 0, 0])), None, "'nan' is not a finite"),
}


@pytest.mark.parametrize(("ending", "name"), [*(("tum", name) for name in TUM), *(("csv", name) for name in CSV)])
def test_a_variant_is_read_or_refused_or_doubted(
    ending: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    table, change, outcome = (CSV if ending == "csv" else TUM)[name]
    separator = "," if ending == "csv" else " "
    rows = [separator.join(map(repr, row)) for row in table(RECORDING.stamps, POSES).tolist()]
    text = "\n".join([*(["step,x,y,theta"] if ending == "csv" else []), *rows, ""])
    path = tmp_path / f"trajectory.{ending}"
    path.write_bytes((text if change is None else change(text)).encode())
    try:
        estimate = load_stored(path, RECORDING).estimate
        said = capsys.readouterr().err
    except UserError as error:
        estimate, said = None, str(error)
        assert len(said.splitlines()) == 1
    if outcome == READ:
        assert said == ""
        assert estimate is not None
        assert_allclose(np.exp(1j * estimate.poses), np.exp(1j * POSES), atol=1e-9)
    else:
        assert outcome in said


@pytest.mark.parametrize(("metres", "doubts"), [(3.9, 0), (4.1, 1)])
def test_a_start_is_doubted_from_a_metre_and_six_sigmas_of_the_prior_on(metres: float, doubts: int) -> None:
    recording = replace(RECORDING, prior_cov=np.diag([0.25, 0.25, 0.01]))
    assert len([*path_doubts(np.add(POSES, [metres, 0.0, 0.0]), recording)]) == doubts


def test_covariances_and_npz_files(tmp_path: Path) -> None:
    path = tmp_path / "mine.tum"
    write_tum(path, RECORDING.stamps, ESTIMATE.poses, ESTIMATE.pose_covs)
    path.write_text("".join(reversed(path.read_text().splitlines(keepends=True))))
    assert_array_equal(load_stored(path, RECORDING).estimate.pose_covs, ESTIMATE.pose_covs)
    save(tmp_path / "estimate.npz", ESTIMATE)
    assert load_stored(tmp_path / "estimate.npz", RECORDING).estimate == ESTIMATE


@pytest.mark.parametrize("log", ["odometry.csv", "truth.csv", None])
def test_the_true_landmarks_of_a_log_are_not_the_map_of_an_estimate(tmp_path: Path, log: str | None) -> None:
    write_rows(tmp_path / "estimate.csv", ("step", *POSE), numbered(RECORDING.stamps, POSES))
    write_rows(tmp_path / "landmarks.csv", ("landmark", "x", "y"), np.array([[7.0, 1.0, 2.0]]))
    if log is not None:
        (tmp_path / log).write_text("anything\n")
    found = load_stored(tmp_path / "estimate.csv", RECORDING).estimate
    assert found.landmark_ids.tolist() == ([7] if log is None else [])


def test_a_gap_of_more_than_a_second_has_no_pose(tmp_path: Path) -> None:
    rows = [[1e9 + stamp, 0.0, 0.0, 0.0] for stamp in (0.0, 0.2, 1.3, *np.arange(1.4, 6.1, 0.1))]
    write_rows(tmp_path / "mine.csv", ("stamp", *POSE), np.array(rows))
    with pytest.raises(UserError, match=r"no pose within 1 s of step 3 at t = .* --max-gap 1.1 accepts it"):
        load_stored(tmp_path / "mine.csv", RECORDING)
    with pytest.raises(UserError, match=r"no pose within 1 s of step 0 .* --time-offset S shifts them$"):
        load_stored(tmp_path / "mine.csv", RECORDING, time_offset=100.0)
    found = load_stored(tmp_path / "mine.csv", RECORDING, max_gap=1.2)
    assert found.own is not None
    assert found.own.compared.nonzero()[0].tolist() == [0, 2, *range(13, 61)]
