"""The command line: what each command writes and prints, and what becomes of bad input."""

from __future__ import annotations

import itertools
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from held_by_schemas import held

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth
from slamgauge.compare.storage.manifest import MANIFEST
from slamgauge.ekf.kernels.warm_up import compile_once
from slamgauge.graph_baseline.warm_up import compile_graphs_once

ROOT = Path(__file__).parents[3]
DATA = ROOT / "../shared/data"
VICTORIA_PARK = DATA / "victoria_park/victoria_park.txt"
LOST_IN_THE_WOODS = DATA / "lost_in_the_woods/dataset2.mat"

# fifteen seconds with one loop closure, in a map of two landmarks
SHORT = ("trajectory.duration=15", "trajectory.yaw_rate=0.5", "sensor.max_range=2.4")
STEPS = 150
SCENARIOS = sorted(path.stem for path in (ROOT / "compare/scenarios").glob("*.toml"))
SHIPPED = ("ekf", "riekf", "isam2", "batch")
TIMES = ("seconds_total", "seconds_per_step_median")

# as in DESIGN.md
METRICS_KEYS = {
    "version",
    "command",
    "scenario_text",
    "scenario",
    "seed",
    "digest",
    "truth",
    "estimators",
    "failures",
    "notes",
}
ESTIMATOR_KEYS = {
    *("kind", "ate_m", "ate_aligned_m", "heading_rmse_rad", "final_position_error_m", "final_heading_error_rad"),
    *("rpe_m", "nees_pose", "nis_per_dof", "landmark_rmse_m", "landmarks_mapped", "landmarks_true"),
    *("wrong_associations", "ratio_to_optimum", "sigma_ratio_to_optimum", "mahalanobis_to_optimum"),
    *("coverage_50", "coverage_95", "coverage_99", "log_score", "log_score_to_optimum", "verdict"),
    *("loop_closure", "seconds_total", "seconds_per_step_median"),
}
CLOSURE_KEYS = {"step", "error_before_m", "error_after_m", "sigma_before_m", "sigma_after_m"}


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "slamgauge", *map(str, arguments)]


def command_after(preparation: str, *arguments: object) -> list[str]:
    """The command, in a process that runs some code before."""
    code = f"{preparation}; import sys; from slamgauge.compare.cli.main import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", code, *map(str, arguments)]


def arrays(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as archive:
        return dict(archive)


def assert_same_estimates(one: Path, other: Path) -> None:
    """Equal to the last bit, computing times aside."""
    for name in SHIPPED:
        first, second = (arrays(folder / "estimates" / f"{name}.npz") for folder in (one, other))
        assert first.keys() == second.keys()
        for field in first.keys() - {"seconds"}:
            np.testing.assert_array_equal(first[field], second[field], field)


def without_times(metrics: dict[str, Any]) -> dict[str, Any]:
    return {
        name: {key: value for key, value in entry.items() if key not in TIMES}
        for name, entry in metrics["estimators"].items()
    }


def metrics_of(folder: Path) -> dict[str, Any]:
    return held("metrics", json.loads((folder / "metrics.json").read_text(encoding="utf-8")))


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    """Where they are compiled for the first time, that is announced on standard error."""
    compile_once()
    compile_graphs_once()


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run of the shipped estimators, with seed 3."""
    folder = tmp_path_factory.mktemp("stored") / "run"
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 3, "--out", folder) == 0
    return folder


# --- scenarios and help ------------------------------------------------------------------------


def test_scenarios_are_listed(capsys: pytest.CaptureFixture[str]):
    assert run("scenarios") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == SCENARIOS
    assert set(SCENARIOS) >= {"q1-long-dense", "q1-long-sparse", "q1-short-dense"}
    assert run("scenarios", "--json") == 0
    entries = json.loads(capsys.readouterr().out)
    assert [[entry["name"], entry["description"]] for entry in entries] == [line.split(maxsplit=1) for line in lines]


@pytest.mark.parametrize(
    ("arguments", "mentions"),
    [
        ([], ["scenarios", "run", "evaluate", "import"]),
        (["scenarios"], ["--json"]),
        (["run"], ["--seed", "--estimators", "--set", "--out", "--json"]),
        (["evaluate"], ["--truth", "--estimators", "--estimates", "--out", "--json", "THIS LOADS AND RUNS"]),
        (["import"], ["victoria-park", "lost-in-the-woods"]),
        (["import", "victoria-park"], ["--out", "--max-range"]),
        (["import", "lost-in-the-woods"], ["--out", "--max-range", "--lateral-slip"]),
    ],
)
def test_help_mentions_every_option(arguments: list[str], mentions: list[str], capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as caught:
        run(*arguments, "--help")
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert [each for each in mentions if each not in text] == []


def test_help_of_the_installed_command_answers_at_once(tmp_path: Path):
    """By the processor's time: other programs may keep it waiting."""
    script = Path(sys.executable).with_name("slamgauge")
    seconds = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([script, "--help"], cwd=tmp_path, capture_output=True, text=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        assert "usage: slamgauge" in done.stdout
    assert min(seconds) < 0.5


def test_the_module_is_the_command(tmp_path: Path):
    done = subprocess.run(command("scenarios", "--json"), cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [entry["name"] for entry in json.loads(done.stdout)] == SCENARIOS
    refused = subprocess.run(command("run", "q9"), cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("slamgauge: q9: no such scenario")


def test_a_reader_that_stops_early_is_no_error(tmp_path: Path):
    arguments = command("scenarios")
    with subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


# --- run and evaluate --------------------------------------------------------------------------


def test_run_writes_every_file(stored: Path):
    names = {str(path.relative_to(stored)) for path in stored.rglob("*") if path.is_file()}
    assert names == {
        MANIFEST,
        "report.html",
        "recording.npz",
        "truth.npz",
        "metrics.json",
        "figure.png",
        "figure.svg",
        "trajectories/truth.tum",
        *(f"estimates/{name}.npz" for name in SHIPPED),
        *(f"trajectories/{name}.tum" for name in SHIPPED),
    }
    assert [path.name for path in stored.parent.iterdir()] == ["run"]
    truth, recording = load_truth(stored / "truth.npz"), load_recording(stored / "recording.npz")
    assert truth.poses is not None
    assert len(truth.poses) == recording.steps + 1 == STEPS + 1
    for name in SHIPPED:
        poses = load_estimate(stored / f"estimates/{name}.npz").poses
        np.testing.assert_array_equal(np.loadtxt(stored / f"trajectories/{name}.tum")[:, 1:3], poses[:, :2])


def test_metrics_have_every_key(stored: Path):
    metrics = metrics_of(stored)
    assert set(metrics) == METRICS_KEYS
    assert (metrics["scenario"], metrics["seed"], metrics["truth"]) == ("q1-long-sparse", 3, True)
    assert re.fullmatch("[0-9a-f]{64}", metrics["digest"])
    assert list(metrics["estimators"]) == list(SHIPPED)
    for name, entry in metrics["estimators"].items():
        assert set(entry) >= ESTIMATOR_KEYS
        assert {name: entry["kind"]} == {name: "smoothed" if name == "batch" else "filtered"}
        assert len(entry["sigma_ratio_to_optimum"]) == 3
        assert [set(closure) for closure in entry["loop_closure"]] == [CLOSURE_KEYS]
    of_optima = {"optimum_check_sigma", "chi_square_per_dof", "observations_left_out"}
    empty = {
        (name, key)
        for name, entry in metrics["estimators"].items()
        for key, value in entry.items()
        if value is None and key not in of_optima and key != "verdict"  # there may be nothing to say
    }
    of_batch = {("batch", key) for key in ("nis_per_dof", "seconds_per_step_median", "yardstick_check_sigma")}
    assert empty == {("isam2", "nis_per_dof")} | of_batch
    filters = [entry for name, entry in metrics["estimators"].items() if name not in ("isam2", "batch")]
    assert all({entry[key] for key in of_optima} == {None} for entry in filters)
    assert metrics["estimators"]["isam2"]["ratio_to_optimum"] == metrics["estimators"]["batch"]["ratio_to_optimum"] == 1


def test_the_seed_decides_everything(stored: Path, tmp_path: Path):
    again, other = tmp_path / "again", tmp_path / "other"
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 3, "--out", again) == 0
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 4, "--out", other) == 0
    assert metrics_of(again)["digest"] == metrics_of(stored)["digest"] != metrics_of(other)["digest"]
    assert_same_estimates(stored, again)
    poses = [load_estimate(folder / "estimates/riekf.npz").poses for folder in (stored, other)]
    assert np.abs(poses[0] - poses[1]).max() > 0.01


def test_run_prints_a_table_and_keeps_talk_off_standard_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    arguments = ("run", "q1-long-sparse", "--set", SHORT[0], "--set", *SHORT[1:], "--estimators", "dead-reckoning, ekf")
    assert run(*arguments) == 0
    printed = capsys.readouterr()
    *lines, luck = printed.out.splitlines()
    assert [line.split()[0] for line in lines] == ["estimator", "dead-reckoning", "ekf", "empty:", "empty:"]
    assert luck.startswith("a single run: ")
    assert printed.err == "written to results/q1-long-sparse-seed-0\n"
    assert run(*arguments, "--json") == 0
    assert json.loads(capsys.readouterr().out) == metrics_of(tmp_path / "results/q1-long-sparse-seed-0")


def test_evaluate_reproduces_the_run(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    before = metrics_of(stored)
    assert run("evaluate", stored / "recording.npz", "--out", tmp_path / "again", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again == metrics_of(tmp_path / "again")
    assert (again["digest"], again["truth"], again["scenario"], again["seed"]) == (before["digest"], True, None, None)
    assert without_times(again) == without_times(before)
    assert_same_estimates(stored, tmp_path / "again")


def test_evaluate_without_truth_invents_nothing(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    shutil.copy(stored / "recording.npz", tmp_path)
    arguments = ("evaluate", tmp_path / "recording.npz", "--estimators", "riekf,isam2", "--json")
    assert run(*arguments) == 0
    blind = json.loads(capsys.readouterr().out)
    needs_truth = ("ate_m", "nees_pose", "landmark_rmse_m", "wrong_associations", "ratio_to_optimum")
    assert [blind["estimators"]["riekf"][key] for key in needs_truth] == [None] * 5
    (closure,) = blind["estimators"]["riekf"]["loop_closure"]
    assert closure["error_before_m"] is closure["error_after_m"] is None
    assert closure["sigma_after_m"] < closure["sigma_before_m"]
    assert blind["truth"] is False
    assert blind["estimators"]["riekf"]["mahalanobis_to_optimum"] > 0
    assert run(*arguments, "--truth", stored / "truth.npz") == 0
    seeing = json.loads(capsys.readouterr().out)
    assert seeing["estimators"]["riekf"]["ate_m"] == metrics_of(stored)["estimators"]["riekf"]["ate_m"]
    assert [path.name for path in tmp_path.iterdir()] == ["recording.npz"]


Module = Callable[[str], str]


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: itertools.count[int]) -> Module:
    """Writes source code to a module in the current folder and returns its import name."""
    folder = tmp_path / "code"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])

    def write(source: str) -> str:
        name = f"own_{next(numbers)}"
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
        return name

    return write


@pytest.fixture(scope="session")
def numbers() -> itertools.count[int]:
    """A module is imported once per process; every test gets one of its own."""
    return itertools.count()


OWN = """
from slamgauge import Estimate, chain
print("loading")
def estimate(recording):
    print("estimating")
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry))
"""


def test_ones_own_estimator_gets_a_row(
    stored: Path, tmp_path: Path, module: Module, capsys: pytest.CaptureFixture[str]
):
    own = f"{module(OWN)}:estimate"
    chosen = ("--estimators", f"dead-reckoning,isam2,{own}")
    assert run("evaluate", stored / "recording.npz", *chosen, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr()
    assert [line.split()[:2] for line in printed.out.splitlines()[1:]] == [
        ["dead-reckoning", "filtered"],
        ["isam2", "filtered"],
        [own, "filtered"],
        ["fit", "of"],
        ["empty:", "NIS/dof:"],
        ["empty:", "end"],
        ["a", "single"],
    ]
    assert printed.err.splitlines() == ["loading", "estimating", f"written to {tmp_path / 'out'}"]
    entries = metrics_of(tmp_path / "out")["estimators"]
    assert entries[own]["ate_m"] == pytest.approx(entries["dead-reckoning"]["ate_m"], rel=1e-9)
    assert entries[own]["ratio_to_optimum"] > 1
    assert entries[own]["nees_pose"] is None
    assert entries[own]["seconds_total"] > 0
    assert load_estimate(tmp_path / "out/estimates" / f"{own}.npz").poses.shape == (STEPS + 1, 3)
    assert run("evaluate", stored / "recording.npz", *chosen, "--json") == 0
    assert set(json.loads(capsys.readouterr().out)["estimators"]) == {"dead-reckoning", "isam2", own}


# --- real recordings ---------------------------------------------------------------------------


@pytest.mark.skipif(not VICTORIA_PARK.exists(), reason=f"{VICTORIA_PARK} is not there")
def test_victoria_park(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run("import", "victoria-park", VICTORIA_PARK, "--out", tmp_path / "park") == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("6968 steps, 3640 observations, no ground truth: written to ")
    assert {path.name for path in (tmp_path / "park").iterdir()} == {"recording.npz", MANIFEST}
    assert run("evaluate", tmp_path / "park/recording.npz", "--estimators", "ekf,riekf,batch", "--json") == 0
    metrics = json.loads(capsys.readouterr().out)
    assert metrics["truth"] is False
    assert metrics["estimators"]["riekf"]["final_distance_to_batch_m"] < 0.1
    assert metrics["estimators"]["ekf"]["final_distance_to_batch_m"] > 2.0
    assert all(entry["ate_m"] is None for entry in metrics["estimators"].values())


@pytest.mark.skipif(not LOST_IN_THE_WOODS.exists(), reason=f"{LOST_IN_THE_WOODS} is not there")
def test_lost_in_the_woods(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "woods"
    assert run("import", "lost-in-the-woods", LOST_IN_THE_WOODS, "--out", out, "--max-range", 5) == 0
    assert "12608 steps, 58135 observations, with ground truth" in capsys.readouterr().err
    assert {path.name for path in out.iterdir()} == {"recording.npz", "truth.npz", MANIFEST}
    assert run("evaluate", out / "recording.npz", "--estimators", "ekf,riekf,batch", "--json") == 0
    metrics = json.loads(capsys.readouterr().out)
    ate = {name: entry["ate_m"] for name, entry in metrics["estimators"].items()}
    assert metrics["truth"] is True
    assert ate["batch"] <= 0.033
    assert ate["riekf"] <= 0.035 < ate["ekf"]


# --- bad input ---------------------------------------------------------------------------------


class Refuse(NamedTuple):
    """Runs a command that must fail and returns its lines on standard error; `out` is to stay as it is."""

    out: Path
    capsys: pytest.CaptureFixture[str]

    def lines(self, *arguments: object, out: Path | None = None) -> list[str]:
        self.capsys.readouterr()
        before = contents(self.out.parent)
        assert run(*arguments, "--out", out or self.out) == 2
        printed = self.capsys.readouterr()
        assert printed.out == ""
        assert contents(self.out.parent) == before
        assert printed.err.startswith("slamgauge: ")
        assert "Traceback" not in printed.err
        return printed.err.removeprefix("slamgauge: ").splitlines()

    def line(self, *arguments: object, out: Path | None = None) -> str:
        lines = self.lines(*arguments, out=out)
        assert len(lines) == 1
        return lines[0]


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every path below a folder, with the bytes of files."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture(params=["new folder", "older results"])
def refuse(request: pytest.FixtureRequest, tmp_path: Path, stored: Path, capsys: pytest.CaptureFixture[str]) -> Refuse:
    """Into a folder that is not there, and into one that holds the results of a run."""
    out = tmp_path / "results/run"
    out.parent.mkdir()
    if request.param == "older results":
        shutil.copytree(stored, out)
    return Refuse(out, capsys)


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
        ("import", "csv", "log", "--set=a.b=1", "--ouut", "x"): "--ouut: no option of `slamgauge import`; did you mean",
        ("run", "q1-long-dense", "--seed", "x"): "Error parsing --seed: ",
        ("run", "q1-long-dense", "more"): "Unrecognized options: more; `slamgauge run --help` tells more",
        ("--versoin",): "--versoin: no option of `slamgauge`; did you mean --version?",
    }
    for arguments, line in told.items():
        assert run(*arguments) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith(f"slamgauge: {line}")
        assert "helptext" not in printed.err
        assert printed.err.count("\n") == 1


ESTIMATE = "from slamgauge import Estimate\nimport numpy as np\nimport sys\n\ndef estimate(recording):\n    "


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            ESTIMATE + "raise KeyError('gain\\nof\\nthe filter')",
            r"it raised KeyError: .*gain.* \(OWN.py, line 6\); mend it",
        ),
        (ESTIMATE + "raise RuntimeError('a\\nb')", r"it raised RuntimeError: a b \(OWN.py, line 6\); mend it"),
        (ESTIMATE + "return None", "returned a NoneType; return a slamgauge.Estimate"),
        (ESTIMATE + "return recording.odometry", "returned a ndarray; return a slamgauge.Estimate"),
        (
            ESTIMATE + "return Estimate('filtered', np.zeros((5, 3)))",
            "returned 5 poses; return 151, one for the start and one for every step",
        ),
        (
            ESTIMATE + "return Estimate('filtered', np.zeros((151, 3)), association=[-1])",
            r"association has 1 entries; return \d+, one for every observation",
        ),
        (
            ESTIMATE + "return Estimate('filtered', np.full((151, 3), np.nan))",
            r"it raised UserError: poses\[0\] = \[nan, nan, nan\]: .* \(OWN.py, line 6\); mend it and run again",
        ),
        (
            ESTIMATE + "recording.odometry[0] = 0.0",
            r"it raised ValueError: assignment destination is read-only \(OWN.py, line 6\)",
        ),
        (ESTIMATE + "recording.stamps += 1.0", r"it raised ValueError: .*read-only \(OWN.py, line 6\)"),
        (ESTIMATE + "recording.odometry = None", r"it raised FrozenInstanceError: .* \(OWN.py, line 6\)"),
        (ESTIMATE + "sys.exit(0)", r"it raised SystemExit: 0 \(OWN.py, line 6\); mend it and run again"),
        (ESTIMATE + "sys.exit()", r"it raised SystemExit: \(no message\) \(OWN.py, line 6\)"),
        ("import sys\nsys.exit(0)", r"cannot be loaded, it raised SystemExit: 0 \(OWN.py, line 2\)"),
        ("def estimate(recording)\n", r"cannot be loaded, it raised SyntaxError: .*OWN.py, line 1\)"),
        ("1 / 0", r"cannot be loaded, it raised ZeroDivisionError: division by zero \(OWN.py, line 1\)"),
        ("import nowhere_at_all", r"cannot be loaded, it raised ModuleNotFoundError: .* \(OWN.py, line 1\)"),
        ("def estimates(recording): ...", "OWN has no 'estimate'; did you mean estimates?"),
        ("", "OWN has no 'estimate'; name a callable Recording -> Estimate of that module"),
        ("estimate = 3", "is a int; give a callable Recording -> Estimate"),
    ],
)
def test_estimators_that_fail(
    stored: Path,
    refuse: Refuse,
    module: Module,
    source: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
):
    """Alone they are a mistake in one line; beside others they are a row with that line as its reason."""
    own = module(source)
    reason = f"estimator {own}:estimate: {message.replace('OWN', own)}.*"
    line = refuse.line("evaluate", stored / "recording.npz", "--estimators", f"{own}:estimate")
    assert re.fullmatch(reason, line)
    assert run("evaluate", stored / "recording.npz", "--estimators", f"dead-reckoning,{own}:estimate") == 1
    head, ours, row, *notes = capsys.readouterr().out.splitlines()
    assert head.split()[0] == "estimator"
    assert ours.split()[:2] == ["dead-reckoning", "filtered"]
    assert row.split()[:2] == [f"{own}:estimate", "failed"]
    assert any(re.fullmatch(reason, note) for note in notes)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere_at_all:estimate", "no module 'nowhere_at_all' is found; run in its folder or install it"),
        ("nowhere.at.all:estimate", "no module 'nowhere' is found; "),
        (":estimate", "write FILE.py:callable or module:callable, for example my_filter.py:estimate"),
        (".relative:estimate", "cannot be loaded, it raised TypeError"),
    ],
)
def test_import_paths_that_lead_nowhere(stored: Path, refuse: Refuse, module: Module, path: str, message: str):
    module("")
    assert message in refuse.line("evaluate", stored / "recording.npz", "--estimators", path)


def test_every_array_that_estimators_see_is_read_only(stored: Path):
    recording = load_recording(stored / "recording.npz")
    for field in fields(recording):
        value = getattr(recording, field.name)
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                value[...] = 0


def test_estimates_are_graded_as_they_lie_and_one_that_cannot_be_read_is_a_row(
    stored: Path, capsys: pytest.CaptureFixture[str]
):
    whole, path = stored / "estimates/ekf.npz", stored / "trajectories/ekf.tum"
    words = ("evaluate", stored / "recording.npz", "--estimators", "isam2", "--json", "--estimates")
    assert run(*words, f"mine={whole}", f"path={path}", "gone=none.csv") == 1
    content = json.loads(capsys.readouterr().out)
    line = "estimator gone: none.csv: cannot be read (No such file or directory); check the path and its permissions"
    assert content["failures"] == [{"estimator": "gone", "error": line}]
    scores, before = content["estimators"], metrics_of(stored)["estimators"]["ekf"]
    assert scores["mine"]["nees_pose"] == before["nees_pose"]
    assert scores["path"]["ate_m"] == pytest.approx(before["ate_m"])
    assert scores["path"]["nees_pose"] is None
    assert (scores["path"]["seconds_total"], scores["mine"]["seconds_total"]) == (None, before["seconds_total"])
    assert run("evaluate", stored / "recording.npz", "--estimators", "", "--estimates", "gone=none.csv") == 2
    assert capsys.readouterr().err == f"slamgauge: {line}\n"


@pytest.mark.parametrize("place", ["FILE", "FILE/run", "/proc/nowhere/run", "/proc/run", "/sys/run"])
def test_places_that_cannot_be_written(stored: Path, tmp_path: Path, refuse: Refuse, place: str):
    if place.startswith("/") and not Path(*Path(place).parts[:2]).exists():
        pytest.skip(f"no {place} on this system")
    (tmp_path / "file").write_text("")
    out = Path(place.replace("FILE", str(tmp_path / "file")))
    for arguments in (("run", "q1-long-sparse"), ("evaluate", stored / "recording.npz")):
        line = refuse.line(*arguments, "--estimators", "dead-reckoning", out=out)
        assert re.fullmatch(f"{out}: cannot be written \\(.+\\); check the path and its permissions", line)
    assert (tmp_path / "file").read_text() == ""


def evaluate_with_room(stored: Path, out: Path, room: int) -> subprocess.CompletedProcess[str]:
    """A command that may write so many bytes into a file."""
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))"
    arguments = ("evaluate", stored / "recording.npz", "--estimators", "dead-reckoning", "--no-report", "--out", out)
    return subprocess.run(command_after(limit, *arguments), capture_output=True, text=True, check=False)


def test_a_disk_that_is_full_costs_the_folder_but_not_the_table(stored: Path, refuse: Refuse):
    before = contents(refuse.out.parent)
    done = evaluate_with_room(stored, refuse.out, 2_000)
    assert (done.returncode, done.stdout.split()[0]) == (2, "estimator")
    assert re.fullmatch(r"slamgauge: \S+: cannot be written \(File too large\); check .*\n", done.stderr)
    assert contents(refuse.out.parent) == before


def test_a_disk_that_fills_up_at_the_figure_costs_that_alone(stored: Path, refuse: Refuse):
    done = evaluate_with_room(stored, refuse.out, 100_000)
    assert (done.returncode, done.stdout.split()[0]) == (1, "estimator")
    lost, written = done.stderr.splitlines()
    assert re.fullmatch(rf"slamgauge: {refuse.out}/figure: left out \(OSError: .*too large.*all else is written", lost)
    assert written == f"written to {refuse.out}"
    assert {path.name for path in refuse.out.iterdir()} == {
        *("recording.npz", "truth.npz", "metrics.json", "estimates", "trajectories", MANIFEST)
    }


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_run_that_is_interrupted_or_terminated_leaves_nothing_behind(refuse: Refuse, number: int, status: int):
    before = contents(refuse.out.parent)
    compile_graphs_once()  # compilation swallows an interrupt now and then
    arguments = ("q1-long-dense", "--set", "trajectory.duration=2000", "--estimators", "isam2", "--out", refuse.out)
    # pytest may run in the background, where interrupts are ignored
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    process = subprocess.Popen(
        command_after(heed, "run", *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        wait_for(lambda: contents(refuse.out.parent) != before)  # the staging folder
        time.sleep(0.5)  # well into iSAM2, which needs minutes
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (status, "", "slamgauge: interrupted; nothing was written\n")
    assert contents(refuse.out.parent) == before


def wait_for(happened: Callable[[], bool], seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.02)


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
