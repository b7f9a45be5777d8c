"""The command line: what becomes of bad input."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.reference.command_line import Refuse, arrays, run

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("keep", [0, 10, 3000])
def test_truncated_recordings_are_refused(stored: Path, tmp_path: Path, refuse: Refuse, keep: int):
    path = tmp_path / "recording.npz"
    path.write_bytes((stored / "recording.npz").read_bytes()[:keep])
    line = refuse.line("evaluate", path)
    assert line == f"{path}: not a whole npz file of plain arrays; write it again with numpy.savez"


@pytest.mark.parametrize(
    ("field", "at", "value", "message"),
    [
        ("odometry", (7, 1), np.nan, "odometry[7] = "),
        ("observation", (3, 0), np.inf, "observation[3] = "),
        ("prior_cov", (0, 1), 0.02, "prior_cov[0]"),
        ("odometry_cov", (5, 2, 2), -1e-4, "odometry_cov[5]"),
        ("landmark", 2, -1, "landmark[2] = -1: an id must be >= 0"),
    ],
)
def test_values_that_cannot_be_are_refused(
    stored: Path, tmp_path: Path, refuse: Refuse, field: str, at: Any, value: float, message: str
):
    changed = arrays(stored / "recording.npz")
    changed[field][at] = value
    np.savez(tmp_path / "recording.npz", **changed)
    assert refuse.line("evaluate", tmp_path / "recording.npz").startswith(f"{tmp_path / 'recording.npz'}: {message}")


def test_a_negative_eigenvalue_is_refused(stored: Path, tmp_path: Path, refuse: Refuse):
    """Positive variances, but a correlation above one."""
    changed = arrays(stored / "recording.npz")
    changed["observation_cov"][4] = [[0.01, 0.02], [0.02, 0.01]]
    np.savez(tmp_path / "recording.npz", **changed)
    line = refuse.line("evaluate", tmp_path / "recording.npz")
    assert line.endswith(
        "observation_cov[4] = [[0.01, 0.02], [0.02, 0.01]]: a covariance must not have a negative eigenvalue"
    )


def test_pickled_objects_are_refused_unread(stored: Path, tmp_path: Path, refuse: Refuse):
    changed = arrays(stored / "recording.npz")
    changed["odometry"] = np.array([Trap(tmp_path / "sprung")], dtype=object)
    np.savez(tmp_path / "recording.npz", **changed)
    assert "not a whole npz file of plain arrays" in refuse.line("evaluate", tmp_path / "recording.npz")
    assert not (tmp_path / "sprung").exists()
    with np.load(tmp_path / "recording.npz", allow_pickle=True) as archive:
        assert archive["odometry"].shape == (1,)
    assert (tmp_path / "sprung").exists()  # the trap was set


@dataclass
class Trap:
    """Leaves a folder behind where it is unpickled."""

    path: Path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def test_the_truth_of_another_recording_is_refused(stored: Path, tmp_path: Path, refuse: Refuse):
    shutil.copy(stored / "recording.npz", tmp_path)
    truth = arrays(stored / "truth.npz")
    observations = len(truth["association"])
    np.savez(tmp_path / "truth.npz", **(truth | {"poses": truth["poses"][:-1]}))
    line = refuse.line("evaluate", tmp_path / "recording.npz")
    assert line == "truth.poses: 150 rows, but the recording needs 151; give its own truth"
    np.savez(tmp_path / "other.npz", **(truth | {"association": truth["association"][1:]}))
    line = refuse.line("evaluate", tmp_path / "recording.npz", "--truth", tmp_path / "other.npz")
    assert line.startswith(f"truth.association: {observations - 1} rows, but the recording needs {observations};")
    line = refuse.line("evaluate", tmp_path / "recording.npz", "--truth", tmp_path / "none.npz")
    assert line.startswith(f"{tmp_path / 'none.npz'}: cannot be read (No such file or directory)")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["q1-long-dens"], ["q1-long-dens: no such scenario; did you mean q1-long-dense"]),
        (["none.toml"], ["none.toml: cannot be read (No such file or directory); check the path"]),
        (
            ["q1-long-dense", "--set", "sensor.max_rnge=5"],
            ["q1-long-dense: sensor.max_rnge: unknown key; did you mean"],
        ),
        (
            ["q1-long-dense", "--set", "sensor.max_range=-5", "motion.sigma_sped=1", "start=somewhere"],
            ["q1-long-dense: start: ", "q1-long-dense: motion.sigma_sped: ", "q1-long-dense: sensor.max_range: "],
        ),
        (["q1-long-dense", "--set", "start"], ["start: not an override; write dotted.key=value"]),
        (["q1-long-dense", "--seed", "-1"], ["seed: -1 is negative; use a whole number >= 0"]),
        (["q1-long-dense", "--estimators", "ekf,isam"], ["estimator 'isam' is not known; did you mean isam2?"]),
        (["q1-long-dense", "--estimators", "ukf99"], ["estimator 'ukf99' is not known; "]),
        (["q1-long-dense", "--estimators", ","], ["estimators: none given; "]),
    ],
)
def test_unknown_names_are_refused(refuse: Refuse, arguments: list[str], expected: list[str]):
    lines = refuse.lines("run", *arguments)
    assert len(lines) == len(expected)
    assert [line for line, start in zip(lines, expected, strict=True) if not line.startswith(start)] == []


def test_mistakes_in_a_scenario_file_are_refused_each_in_a_line(refuse: Refuse, tmp_path: Path):
    path = tmp_path / "mine.toml"
    shipped = (ROOT / "compare/scenarios/q1-long-sparse.toml").read_text(encoding="utf-8")
    path.write_text(shipped.replace("max_range", "maximal_range").replace("speed = 1.0", 'speed = "fast"'))
    lines = refuse.lines("run", path)
    assert lines == [
        f"{path}: trajectory.speed: must be a valid number, not 'fast'",
        f"{path}: sensor.maximal_range: unknown key; did you mean max_range?",
    ]


def test_misspelt_commands_and_options_are_refused(capsys: pytest.CaptureFixture[str]):
    told = {
        ("rnu",): "rnu: no such command; did you mean run?",
        (): "no command is given; use one of scenarios, run, ",
        ("run",): "Missing from slamgauge run: ",
        ("run", "q1-long-dense", "--sead", "1"): "--sead: no option of `slamgauge run`; did you mean --seed?",
        ("run", "q1-long-dense", "-seed", "1"): "-seed: no option of `slamgauge run`; did you mean --seed?",
        ("twin", "log.npz", "--run", "3"): "--run: no option of `slamgauge twin`; `slamgauge twin --help` lists",
        ("schema", "metrics", "--json"): "--json: no option of `slamgauge schema`; `slamgauge schema --help` lists",
        ("import", "csv", "log", "--set=a.b=1", "--ouut", "x"): "--ouut: no option of `slamgauge import`; did you mean",
        ("run", "q1-long-dense", "--seed", "x"): "Error parsing --seed: ",
        ("run", "q1-long-dense", "--seed", "9" * 5000): "Error parsing --seed: has more than 4300 digits, give fewer",
        ("run", "q1-long-dense", "more"): "Unrecognized options: more; see `slamgauge run --help`",
        ("animate", ".", "--out", "x"): "--out: no option of `slamgauge animate`; `slamgauge animate --help` lists",
        ("--versoin",): "--versoin: no option of `slamgauge`; did you mean --version?",
    }
    for arguments, line in told.items():
        assert run(*arguments) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith(f"slamgauge: {line}")
        assert "helptext" not in printed.err
        assert printed.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["victoria-park", "none.txt"], "none.txt: cannot be read (No such file or directory); check the path"),
        (["lost-in-the-woods", "none.mat"], "none.mat: cannot be read (No such file or directory); check the path"),
        (["victoria-park", str(Path(__file__))], ", line 1: "),
        (["lost-in-the-woods", str(Path(__file__))], "not a MATLAB 5"),
    ],
)
def test_imports_of_other_files_are_refused(refuse: Refuse, arguments: Sequence[str], message: str):
    assert message in refuse.line("import", *arguments)
