"""The command line: what each command writes and prints."""

from __future__ import annotations

import json
import re
import shutil
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.cli import terminal
from slamgauge.compare.cli.main import COMMANDS
from slamgauge.compare.estimators.registry import BOUNDS
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth
from slamgauge.compare.storage.staged_folder import MARK
from tests.reference.command_line import SHORT, Module, assert_equal_arrays, metrics_of, run

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
DATA = ROOT / "../shared/data"
VICTORIA_PARK = DATA / "victoria_park/victoria_park.txt"
LOST_IN_THE_WOODS = DATA / "lost_in_the_woods/dataset2.mat"

STEPS = 150
SCENARIOS = sorted(path.stem for path in (ROOT / "compare/scenarios").glob("*.toml"))
SHIPPED = ("ekf", "riekf", "causal", "batch")
TIMES = ("seconds_total",)


def without_times(metrics: dict[str, Any]) -> dict[str, Any]:
    return {
        name: {key: value for key, value in entry.items() if key not in TIMES}
        for name, entry in metrics["estimators"].items()
    }


# --- scenarios and help ------------------------------------------------------------------------


def test_scenarios_are_listed(capsys: pytest.CaptureFixture[str]):
    assert run("scenarios") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == SCENARIOS
    assert set(SCENARIOS) >= {"q1-long-dense", "q1-long-sparse", "q1-short-dense"}
    assert run("scenarios", "--json") == 0
    entries = json.loads(capsys.readouterr().out)
    assert [[entry["name"], entry["description"]] for entry in entries] == [line.split(maxsplit=1) for line in lines]


def test_scenarios_fit_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(terminal, "PIPED", 80)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(terminal.sys.stdout, "isatty", lambda: True, raising=False)
    assert run("scenarios") == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == SCENARIOS


def help_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as caught:
        run(*words, "--help")
    assert caught.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "mentions"),
    [
        ([], ["Is your EKF-SLAM overconfident", "scenarios", "run", "evaluate", "import"]),
        (["scenarios"], ["--json"]),
        (["animate"], ["--estimators", "--seconds", "--fps", "animation.gif"]),
        (["run"], ["--seed", "--estimators", "--set", "--out", "--json"]),
        (["evaluate"], ["--truth", "--estimators", "--estimates", "--out", "--json", "THIS LOADS AND RUNS"]),
        (["import"], ["victoria-park", "lost-in-the-woods"]),
        (["import", "victoria-park"], ["--out", "--max-range"]),
        (["import", "lost-in-the-woods"], ["--out", "--max-range", "--lateral-slip"]),
    ],
)
def test_help_mentions_every_option(
    arguments: list[str], mentions: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "1000")  # no line is broken
    text = help_of(capsys, *arguments)
    assert [each for each in mentions if each not in text] == []


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str, capsys: pytest.CaptureFixture[str]):
    assert re.search(rf"^  slamgauge {command} ?", help_of(capsys, command), re.MULTILINE)


@pytest.mark.parametrize("command", ["run", "evaluate", "study", "budget", "grade"])
def test_help_of_large_commands_is_in_groups(command: str, capsys: pytest.CaptureFixture[str]):
    groups = re.split(r"(?m)^\W*((?:\S+ )?options)\W*$", help_of(capsys, command))[1:]
    sizes = {name: len(re.findall(r"(?m)^\W* --", text)) for name, text in zip(groups[::2], groups[1::2], strict=True)}
    assert {"options", "page options", "output options"} <= sizes.keys()
    assert max(sizes.values()) <= 10


@pytest.mark.parametrize("command", ["run", "evaluate", "bench"])
def test_help_offers_no_estimator_that_the_command_refuses(command: str, capsys: pytest.CaptureFixture[str]):
    offered = help_of(capsys, command)
    assert "gtsam-batch" in offered
    assert not [name for name in BOUNDS if re.search(rf"(?<![\w-]){name}(?![\w-])", offered)]


# --- run and evaluate --------------------------------------------------------------------------


def test_run_writes_every_file(stored: Path):
    names = {str(path.relative_to(stored)) for path in stored.rglob("*") if path.is_file()}
    assert names == {
        MARK,
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


def test_metrics_have_every_value_that_exists(stored: Path):
    """The values that are None are those that an estimator cannot have."""
    metrics = metrics_of(stored)
    assert (metrics["scenario"], metrics["seed"], metrics["truth"]) == ("q1-long-sparse", 3, True)
    assert re.fullmatch("[0-9a-f]{64}", metrics["digest"])
    entries = metrics["estimators"]
    assert list(entries) == list(SHIPPED)
    assert {name: entry["kind"] for name, entry in entries.items()} == dict.fromkeys(SHIPPED, "filtered") | {
        "batch": "smoothed"
    }
    of_optima = {"optimum_check_sigma", "chi_square_per_dof"}
    empty: set[tuple[str, str]] = set()
    for name, entry in entries.items():
        assert len(entry["loop_closure"]) == 1
        missing = {key for key, value in entry.items() if value is None}
        assert (of_optima <= missing) == (name not in ("causal", "batch"))
        empty |= {(name, key) for key in missing - of_optima - {"verdict"}}
    of_batch = {("batch", key) for key in ("nis_per_dof", "yardstick_check_sigma")}
    assert empty == {("causal", "nis_per_dof")} | of_batch
    assert entries["causal"]["ratio_to_optimum"] == entries["batch"]["ratio_to_optimum"] == 1


@pytest.mark.usefixtures("empty_pictures")
def test_another_seed_gives_another_run(stored: Path, tmp_path: Path):
    """That the same seed gives the same run is in `test_repeatable_results.py`."""
    other = tmp_path / "other"
    assert run("run", "q1-long-sparse", "--set", *SHORT, "--seed", 4, "--out", other) == 0
    assert metrics_of(stored)["digest"] != metrics_of(other)["digest"]
    poses = [load_estimate(folder / "estimates/riekf.npz").poses for folder in (stored, other)]
    assert np.abs(poses[0] - poses[1]).max() > 0.01


@pytest.mark.usefixtures("empty_pictures")
def test_run_prints_a_table_and_writes_notes_on_standard_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    arguments = ("run", "q1-long-sparse", "--set", SHORT[0], "--set", *SHORT[1:], "--estimators", "dead-reckoning, ekf")
    assert run(*arguments) == 0
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    begins = [line.split()[0] for line in lines if line[0] != " "]
    assert begins == ["estimator", "dead-reckoning", "ekf", "One", "Empty"]
    assert f"slamgauge study q1-long-sparse --runs 100 --estimators 'dead-reckoning, ekf' --set {' '.join(SHORT)}" in (
        " ".join(line.strip() for line in lines)
    )
    assert printed.err == "written to results/q1-long-sparse-seed-0\n"
    assert run(*arguments, "--json") == 0
    assert json.loads(capsys.readouterr().out) == metrics_of(tmp_path / "results/q1-long-sparse-seed-0")


@pytest.mark.usefixtures("empty_pictures")
def test_evaluate_reproduces_the_run(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    before = metrics_of(stored)
    assert run("evaluate", stored / "recording.npz", "--out", tmp_path / "again", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again == metrics_of(tmp_path / "again")
    assert (again["digest"], again["truth"], again["scenario"], again["seed"]) == (before["digest"], True, None, None)
    assert without_times(again) == without_times(before)
    for name in SHIPPED:
        assert_equal_arrays(*(folder / "estimates" / f"{name}.npz" for folder in (stored, tmp_path / "again")))


def test_the_page_is_opened_with_open(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    opened: list[str] = []

    def browse(address: str) -> bool:
        opened.append(address)
        return len(opened) == 1

    monkeypatch.setattr(webbrowser, "open", browse)
    arguments = ("evaluate", stored / "recording.npz", "--estimators", "ekf", "--out", tmp_path / "a page")
    assert run(*arguments, "--no-report", "--open") == 0
    assert run(*arguments, "--open") == 0
    assert run(*arguments, "--open") == 0
    assert opened == [(tmp_path / "a page" / "report.html").as_uri()] * 2
    assert capsys.readouterr().err.endswith(f"no browser was found; open {tmp_path / 'a page' / 'report.html'}\n")


def test_evaluate_without_truth_has_no_errors(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    shutil.copy(stored / "recording.npz", tmp_path)
    arguments = ("evaluate", tmp_path / "recording.npz", "--estimators", "riekf,causal", "--json")
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


OWN = """
from slamgauge import Estimate, chain
print("loading")
def estimate(recording):
    print("estimating")
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry))
"""


@pytest.mark.usefixtures("empty_pictures")
def test_user_code_gets_a_row(stored: Path, tmp_path: Path, module: Module, capsys: pytest.CaptureFixture[str]):
    own = f"{module(OWN)}:estimate"
    chosen = ("--estimators", f"dead-reckoning,causal,{own}")
    assert run("evaluate", stored / "recording.npz", *chosen, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr()
    assert [line.split()[:2] for line in printed.out.splitlines()[1:]] == [
        ["dead-reckoning", "filtered"],
        ["causal", "filtered"],
        [own, "filtered"],
        ["One", "run:"],
        ["Empty", "columns:"],
        ["fit", "of"],
    ]
    kept, written = printed.err.splitlines()
    assert kept.startswith(f"slamgauge: {own}: what it prints is kept in ")
    assert Path(kept.rpartition(" in ")[2]).read_text() == "estimating\n"
    assert written == f"written to {tmp_path / 'out'}"
    entries = metrics_of(tmp_path / "out")["estimators"]
    assert entries[own]["ate_m"] == pytest.approx(entries["dead-reckoning"]["ate_m"], rel=1e-9)
    assert entries[own]["ratio_to_optimum"] > 1
    assert entries[own]["nees_pose"] is None
    assert entries[own]["seconds_total"] > 0
    assert load_estimate(tmp_path / "out/estimates" / f"{own}.npz").poses.shape == (STEPS + 1, 3)
    assert run("evaluate", stored / "recording.npz", *chosen, "--json") == 0
    assert set(json.loads(capsys.readouterr().out)["estimators"]) == {"dead-reckoning", "causal", own}


def test_stored_estimates_are_scored_and_an_unreadable_one_is_a_row(stored: Path, capsys: pytest.CaptureFixture[str]):
    whole, path = stored / "estimates/ekf.npz", stored / "trajectories/ekf.tum"
    words = ("evaluate", stored / "recording.npz", "--estimators", "causal", "--json", "--estimates")
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


# --- real recordings ---------------------------------------------------------------------------


def imported_and_scored(capsys: pytest.CaptureFixture[str], out: Path, *words: object) -> tuple[str, dict[str, Any]]:
    """Import a recording and score estimators on it; return the note of the import and the metrics."""
    assert run("import", *words, "--out", out) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    assert run("evaluate", out / "recording.npz", "--estimators", "ekf,riekf,batch", "--json") == 0
    return printed.err, json.loads(capsys.readouterr().out)


@pytest.mark.full  # a real recording of 6968 steps
@pytest.mark.skipif(not VICTORIA_PARK.exists(), reason=f"{VICTORIA_PARK} is not there")
def test_victoria_park(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    note, metrics = imported_and_scored(capsys, tmp_path / "park", "victoria-park", VICTORIA_PARK)
    assert "6968 steps, 3640 observations, no ground truth: written to " in note
    assert {path.name for path in (tmp_path / "park").iterdir()} == {"recording.npz", MARK}
    assert metrics["truth"] is False
    assert metrics["estimators"]["riekf"]["final_distance_to_batch_m"] < 0.1
    assert metrics["estimators"]["ekf"]["final_distance_to_batch_m"] > 2.0
    assert all(entry["ate_m"] is None for entry in metrics["estimators"].values())


@pytest.mark.full  # a real recording of 12608 steps
@pytest.mark.skipif(not LOST_IN_THE_WOODS.exists(), reason=f"{LOST_IN_THE_WOODS} is not there")
def test_lost_in_the_woods(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = ("lost-in-the-woods", LOST_IN_THE_WOODS, "--max-range", 5)
    note, metrics = imported_and_scored(capsys, tmp_path / "woods", *words)
    assert "12608 steps, 58135 observations, with ground truth" in note
    assert {path.name for path in (tmp_path / "woods").iterdir()} == {"recording.npz", "truth.npz", MARK}
    ate = {name: entry["ate_m"] for name, entry in metrics["estimators"].items()}
    assert metrics["truth"] is True
    assert ate["batch"] <= 0.033
    assert ate["riekf"] <= 0.035 < ate["ekf"]
