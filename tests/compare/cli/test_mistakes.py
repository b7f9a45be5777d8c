"""Mistakes of users, defects and refusals of the machine: one line on standard error, an exit status, no results."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import slamgauge
from slamgauge import load_scenario, save, simulate
from slamgauge.compare.estimators.memory_check import require_room_for_runs
from tests.reference.command_line import Refuse, arrays, run

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
MANY = "100000000"


@pytest.fixture
def mistake(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a command that ends with a status, and returns its single line on standard error."""

    def line(*arguments: object, status: int = 2) -> str:
        assert run(*arguments) == status
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("slamgauge: ")
        assert len(printed.err.splitlines()) == 1
        return printed.err.removeprefix("slamgauge: ").removesuffix("\n")

    return line


# --- input files -------------------------------------------------------------------------------


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
        (  # positive variances, but a correlation above one
            *("observation_cov", 4, [[0.01, 0.02], [0.02, 0.01]]),
            "observation_cov[4] = [[0.01, 0.02], [0.02, 0.01]]: a covariance must not have a negative eigenvalue",
        ),
    ],
)
def test_impossible_values_are_refused(
    stored: Path, tmp_path: Path, refuse: Refuse, field: str, at: Any, value: Any, message: str
):
    changed = arrays(stored / "recording.npz")
    changed[field][at] = value
    np.savez(tmp_path / "recording.npz", **changed)
    assert refuse.line("evaluate", tmp_path / "recording.npz").startswith(f"{tmp_path / 'recording.npz'}: {message}")


def test_pickled_objects_are_refused_and_not_loaded(stored: Path, tmp_path: Path, refuse: Refuse):
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
    """Makes a folder when it is unpickled."""

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


def test_each_mistake_in_a_scenario_file_is_a_line(refuse: Refuse, tmp_path: Path):
    path = tmp_path / "mine.toml"
    shipped = (ROOT / "compare/scenarios/q1-long-sparse.toml").read_text(encoding="utf-8")
    path.write_text(shipped.replace("max_range", "maximal_range").replace("speed = 1.0", 'speed = "fast"'))
    lines = refuse.lines("run", path)
    assert lines == [
        f"{path}: trajectory.speed: must be a valid number, not 'fast'",
        f"{path}: sensor.maximal_range: unknown key; did you mean max_range?",
    ]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("rnu", "rnu: no such command; did you mean run?"),
        ("", "no command is given; use one of exercise, scenarios, run, "),
        ("run", "Missing from slamgauge run: "),
        ("run q1-long-dense --sead 1", "--sead: no option of `slamgauge run`; did you mean --seed?"),
        ("run q1-long-dense -seed 1", "-seed: no option of `slamgauge run`; did you mean --seed?"),
        ("twin log.npz --run 3", "--run: no option of `slamgauge twin`; `slamgauge twin --help` lists"),
        ("import csv log --set=a.b=1 --ouut x", "--ouut: no option of `slamgauge import`; did you mean"),
        ("run q1-long-dense --seed x", "Error parsing --seed: "),
        ("run q1-long-dense more", "Unrecognized options: more; see `slamgauge run --help`"),
        ("animate . --out x", "--out: no option of `slamgauge animate`; `slamgauge animate --help` lists"),
        ("--versoin", "--versoin: no option of `slamgauge`; did you mean --version?"),
    ],
)
def test_misspelt_commands_and_options_are_refused(words: str, line: str, mistake: Callable[..., str]):
    found = mistake(*words.split())
    assert found.startswith(line)
    assert "helptext" not in found


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["victoria-park", "none.txt"], "none.txt: cannot be read (No such file or directory); check the path"),
        (["lost-in-the-woods", "none.mat"], "none.mat: cannot be read (No such file or directory); check the path"),
        (["victoria-park", str(Path(__file__))], ", line 1: "),
        (["lost-in-the-woods", str(Path(__file__))], "not a whole MATLAB 5 file"),
    ],
)
def test_imports_of_other_files_are_refused(refuse: Refuse, arguments: Sequence[str], message: str):
    assert message in refuse.line("import", *arguments)


def test_line_ends_in_names_are_escaped(mistake: Callable[..., str]):
    assert mistake("evaluate", "a\u2028b\x1b.npz").startswith("a\\u2028b\\x1b.npz: cannot be read")


def test_paths_that_are_too_long_are_one_line(mistake: Callable[..., str]):
    mistake("evaluate", "x" * 5000)
    mistake("export", "csv", "[" * 3000, "--out", "x")


# --- memory and processes ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "start"),
    [
        (("study", "q1-short-dense", "--runs", MANY), "runs: to sum up 100000000 of"),
        (("study", "q1-short-dense", "--runs", MANY, "--sweep", "association.gate=1,9"), "runs: to sum up"),
        (("grade", "examples", "--scenario", "q1-short-dense", "--runs", MANY, "--unconfined"), "runs: to sum up"),
        (("budget", "q1-short-dense", "--runs", "100000000000"), "runs: a budget of 100000000000"),
        (("bench", "--landmarks", MANY), "landmarks: the covariance of 100000000 needs"),
    ],
)
def test_results_that_do_not_fit_into_memory_are_refused(
    words: tuple[str, ...], start: str, tmp_path: Path, mistake: Callable[..., str]
):
    line = mistake(*words, "--out", tmp_path / "out")
    assert line.startswith(start)
    assert " GB are free; " in line


def test_estimates_that_do_not_fit_into_memory_are_refused_before_the_first(
    tmp_path: Path, mistake: Callable[..., str], monkeypatch: pytest.MonkeyPatch
):
    """A recording of 628 steps, with memory for the estimates of one filter, but not for those of three."""
    save(tmp_path / "r.npz", simulate("q1-short-dense", 0)[1])
    evaluate = ["evaluate", tmp_path / "r.npz", "--estimators"]
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e5)
    line = mistake(*evaluate, "ekf,riekf,fej-ekf")
    assert re.fullmatch(
        r"estimators: 3 of 628 steps: what they estimate needs 0.0 GB of memory, .*; give fewer.*", line
    )
    assert run(*evaluate, "dead-reckoning") == 0


@pytest.mark.parametrize("graph", ["causal", "fixed-lag-5"])
def test_a_graph_that_does_not_fit_into_memory_is_refused_before_the_first_estimator(
    graph: str, tmp_path: Path, mistake: Callable[..., str], monkeypatch: pytest.MonkeyPatch
):
    """Until 0.4 dead reckoning of 100 000 landmarks ran for minutes before the optimum was refused."""
    monkeypatch.setattr("slamgauge.compare.scoring.comparison.compare_estimators", pytest.fail)
    many = "landmarks={random={count=9000,box=[-5.0,-5.0,5.0,5.0]}}"
    words = ("run", "q1-short-dense", "--set", many, "trajectory.duration=0.2", "--out", tmp_path / "out")
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e9)
    line = mistake(*words, "--estimators", f"dead-reckoning,{graph}")
    what = f"{graph} of 9000 landmarks in 3 poses"
    assert re.fullmatch(rf"{what} needs [\d.]+ GB of memory, and 2.0 GB are free; .*", line)


def test_a_run_that_does_not_fit_is_refused_by_its_steps_or_observations(monkeypatch: pytest.MonkeyPatch):
    for free, start in ((1e4, "a run of 628 steps among"), (4e5, r"a run of \d{4} observations")):
        monkeypatch.setattr("slamgauge.memory.free_memory", lambda free=free: free)
        with pytest.raises(ValueError, match=rf"^{start} [^\n]*needs 0.0 GB of memory.*; shorten trajectory.duration"):
            simulate("q1-short-dense", 0)


def test_a_map_size_of_thousands_of_digits_is_refused(mistake: Callable[..., str]):
    line = mistake("bench", "--landmarks", "1" * 5000)
    assert re.fullmatch(r"landmarks '1+: give map sizes > 0, for example 20,100", line)


def test_a_usual_study_is_not_refused():
    require_room_for_runs(1000, load_scenario("q1-long-dense"), 3)


@pytest.mark.parametrize("jobs", ["0", "1025", str(2**64)])
def test_a_number_of_processes_out_of_range_is_refused(jobs: str, tmp_path: Path, mistake: Callable[..., str]):
    words = ("study", "q1-short-dense", "--runs", "1", "--estimators", "dead-reckoning", "--jobs", jobs)
    assert mistake(*words, "--out", tmp_path / "out") == f"jobs: {jobs} is out of range; give 1 to 1024"


# --- exit status -------------------------------------------------------------------------------


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]):
    assert run("--version") == 0
    assert capsys.readouterr().out == f"slamgauge {slamgauge.__version__}\n"


@pytest.mark.parametrize("error", [KeyError("gain"), ValueError("operands could not be broadcast"), RuntimeError("?")])
def test_other_errors_are_defects_with_a_traceback_and_where_to_report_them(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("slamgauge.compare.cli.scenarios.shipped_scenarios", Mock(side_effect=error))
    assert run("scenarios") == 70
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = printed.err.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert lines[-2].startswith(type(error).__name__)
    assert lines[-1].startswith("slamgauge: this is a defect of slamgauge, not a mistake of yours; please report it")
    assert f"slamgauge {slamgauge.__version__}" in lines[-1]


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 8 TiB"), OSError(errno.ENOSPC, "No space left on device")]
)
def test_refusals_of_the_machine_are_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, mistake: Callable[..., str]
):
    monkeypatch.setattr("slamgauge.compare.cli.scenarios.shipped_scenarios", Mock(side_effect=error))
    line = mistake("scenarios", status=71)
    assert str(error) in line
    assert line.endswith("; make room and give the same command again")
