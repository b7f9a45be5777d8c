"""Variants of a stored trajectory: each is read as it was meant, or refused or doubted in a line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.errors import UserError
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
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
Table = Callable[[Float, Float], Float]  # rows of a file from stamps and poses
Text = Callable[[str], str]


def same(text: str) -> str:
    return text


def tum(stamps: Float, poses: Float) -> Float:
    x, y, heading = poses.T
    zero = np.zeros_like(x)
    return np.column_stack([stamps, x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)])


def numbered(_: Float, poses: Float) -> Float:
    return np.column_stack([np.arange(len(poses), dtype=np.float64), poses])


def scaled(form: Table, *factors: float) -> Table:
    return lambda stamps, poses: form(stamps, poses * factors)


def columns(form: Table, *order: int) -> Table:
    return lambda stamps, poses: form(stamps, poses)[:, order]


def changed(form: Table, change: Callable[[Float], Float]) -> Table:
    return lambda stamps, poses: change(form(stamps, poses))


def rounded(digits: int) -> Table:
    return changed(tum, lambda rows: np.column_stack([np.round(rows[:, 0], digits), rows[:, 1:]]))


def turned(poses: Float) -> Float:
    return np.column_stack([poses[:, :2] @ TURN.T, poses[:, 2] + np.pi / 2])


QZ_IS_HEADING = changed(tum, lambda rows: np.column_stack([rows[:, :6], 2 * np.arcsin(rows[:, 6]), rows[:, 7]]))
VARIANTS: dict[str, tuple[str, Table, Text, str]] = {
    # name of a variant: ending of the file, its rows, change of its text, what must happen
    "tum": ("tum", tum, same, READ),
    "tum, any order of lines": ("tum", changed(tum, lambda rows: rows[::-1]), same, READ),
    "tum, quaternions negated": ("tum", changed(tum, lambda rows: rows * [1, 1, 1, 1, -1, -1, -1, -1]), same, READ),
    "tum, commas": ("tum", tum, lambda text: text.replace(" ", ","), READ),
    "tum, tabs": ("tum", tum, lambda text: text.replace(" ", "\t"), READ),
    "tum, byte order mark": ("tum", tum, lambda text: "\ufeff" + text, READ),
    "tum, header behind #": ("tum", tum, lambda text: "# t x y z qx qy qz qw\n" + text, READ),
    "tum, blank lines and Windows": ("tum", tum, lambda text: text.replace("\n", "\r\n") + "\r\n\r\n", READ),
    "tum, a height": ("tum", changed(tum, lambda rows: np.add(rows, [0, 0, 0, 5, 0, 0, 0, 0])), same, READ),
    "tum, a header without #": ("tum", tum, lambda text: "t x y z qx qy qz qw\n" + text, "line 1"),
    "tum, wxyz": ("tum", columns(tum, 0, 1, 2, 3, 7, 4, 5, 6), same, "the columns are not in the order qx qy qz qw"),
    "tum, norm 2": ("tum", changed(tum, lambda rows: rows * [1, 1, 1, 1, 2, 2, 2, 2]), same, "has the length 2"),
    "tum, norm 0": ("tum", changed(tum, lambda rows: rows * [1, 1, 1, 1, 0, 0, 0, 0]), same, "has the length 0"),
    "tum, heading in qz": ("tum", QZ_IS_HEADING, same, "write unit quaternions"),
    "tum, no rotation": ("tum", scaled(tum, 1, 1, 0), same, "times the turns of the odometry"),
    "tum, millimetres": ("tum", scaled(tum, 1e3, 1e3, 1), same, "times the distances of the odometry"),
    "tum, clockwise": ("tum", scaled(tum, 1, 1, -1), same, "times the turns of the odometry"),
    "tum, mirrored": ("tum", scaled(tum, 1, -1, -1), same, "times the turns of the odometry"),
    "tum, x and y exchanged": ("tum", columns(tum, 0, 2, 1, 3, 4, 5, 6, 7), same, "times the distances"),
    "tum, another frame": ("tum", lambda t, poses: tum(t, turned(poses)), same, "far from the prior"),
    "tum, another clock": ("tum", lambda t, poses: tum(t - 1e9, poses), same, "no pose within 1 s of step 0"),
    "tum, stamps in ms": ("tum", lambda t, poses: tum(1e3 * t, poses), same, "no pose within 1 s of step 0"),
    "tum, CR only": ("tum", tum, lambda text: text.replace("\n", "\r"), READ),
    "tum, stamps of 10 ms": ("tum", rounded(2), same, READ),
    "tum, stamps in whole seconds": ("tum", rounded(0), same, "poses have the stamp of the pose before, and another"),
    "tum, each line twice": ("tum", changed(tum, lambda rows: np.repeat(rows, 2, axis=0)), same, READ),
    "tum, infinite": (
        "tum",
        changed(tum, lambda rows: np.where(np.arange(61)[:, None] == 9, np.inf, rows)),
        same,
        "line 10, column 1: 'inf' is not a finite",
    ),
    "tum, covariance nan": (
        "tum",
        lambda t, poses: np.column_stack([tum(t, poses), np.full((len(poses), 6), np.nan)]),
        same,
        "line 1, column 9: 'nan' is not a finite",
    ),
    "tum, two seconds missing": (
        "tum",
        changed(tum, lambda rows: np.delete(rows, slice(20, 40), axis=0)),
        same,
        "no pose within 1 s of step 20 at t = 1000000002.0",
    ),
    "tum, one line missing": ("tum", changed(tum, lambda rows: np.delete(rows, 7, axis=0)), same, ""),
    "kitti": ("txt", lambda _, poses: np.zeros((len(poses), 12)), same, "12 columns"),
    "csv": ("csv", numbered, same, READ),
    "csv, headings not wrapped": (
        "csv",
        changed(numbered, lambda rows: np.add(rows, [0, 0, 0, 4 * np.pi])),
        same,
        READ,
    ),
    "csv, blank lines at the end": ("csv", numbered, lambda text: text + "\n\n", READ),
    "csv, the last number cut short": ("csv", numbered, lambda text: text[:-5], "no line end after"),
    "tum, the last number cut short": ("tum", tum, lambda text: text[:-5], "no line end after"),
    "csv, byte order mark": ("csv", numbered, lambda text: "\ufeff" + text, READ),
    "csv, degrees": ("csv", scaled(numbered, 1, 1, 180 / np.pi), same, "times the turns of the odometry"),
    "csv, millimetres": ("csv", scaled(numbered, 1e3, 1e3, 1), same, "times the distances of the odometry"),
    "csv, clockwise": ("csv", scaled(numbered, 1, 1, -1), same, "times the turns of the odometry"),
    "csv, semicolons": ("csv", numbered, lambda text: text.replace(",", ";"), READ),
    "csv, no header": ("csv", numbered, lambda text: text.split("\n", 1)[1], "is not the header"),
    "csv, other order": ("csv", numbered, lambda text: text.replace("x,y", "y,x", 1), "is not the header"),
    "csv, from step 1": ("csv", changed(numbered, lambda rows: rows[1:]), same, "step 1, expected 0"),
    "csv, a step missing": ("csv", changed(numbered, lambda rows: np.delete(rows, 7, axis=0)), same, "expected 7"),
    "csv, nan": ("csv", changed(numbered, lambda rows: np.add(rows, [0, np.nan, 0, 0])), same, "'nan' is not a finite"),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_read_or_refused_or_doubted(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    ending, table, change, outcome = VARIANTS[name]
    separator = "," if ending == "csv" else " "
    rows = [separator.join(map(repr, row)) for row in table(RECORDING.stamps, POSES).tolist()]
    path = tmp_path / f"trajectory.{ending}"
    path.write_bytes(change("\n".join([*(["step,x,y,theta"] if ending == "csv" else []), *rows, ""])).encode())
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
