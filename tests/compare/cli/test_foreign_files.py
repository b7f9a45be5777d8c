"""No command writes into a folder of somebody else, and none leaves files of an earlier one among its results."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.staged_folder import MARK
from tests.reference.command_line import contents
from tests.reference.robot_logs import CSV

pytestmark = [pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures"), pytest.mark.slow]

SHORT = ("--set", "trajectory.duration=3")
STUDY = ("study", "q2-long-dense", *SHORT, "--runs", "1", "--jobs", "1", "--estimators", "ekf,causal")
COMMANDS = {
    "run": ("run", "q1-short-dense", *SHORT, "--estimators", "ekf"),
    "evaluate": ("evaluate", "INPUT/recording.npz", "--estimators", "ekf"),
    "import": ("import", "csv", "INPUT/log"),
    "export": ("export", "csv", "INPUT"),
    "budget": ("budget", "q1-long-dense", *SHORT, "--runs", "1", "--jobs", "1"),
    "bench": ("bench", "--landmarks", "5", "--estimators", "dead-reckoning"),
    "exercise": ("exercise", "q1", "--runs", "1", "--jobs", "1"),
    "study": STUDY,
    "sweep": (*STUDY, "--sweep", "association.gate=4,9"),
    "twin": ("twin", "INPUT/recording.npz"),
    "grade": ("grade", "INPUT/class", "--scenario", "INPUT/short.toml", "--runs", "2", "--jobs", "1", "--unconfined"),
    "noise": ("noise", "INPUT/recording.npz"),
}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the inputs of all commands."""
    folder = tmp_path_factory.mktemp("given") / "input"
    assert main([*COMMANDS["run"], "--out", str(folder)]) == 0
    (folder / "log").mkdir()
    for name, text in CSV.items():
        (folder / "log" / name).write_text(text)
    (folder / "short.toml").write_text('extends = "q1-long-dense"\n[trajectory]\nduration = 3.0\n')
    (folder / "class").mkdir()
    (folder / "class/dead.py").write_text("from slamgauge import dead_reckoning as estimate\n")
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_folders_of_others_are_refused(name: str, given: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """`staged_folder` and `require_ours` refuse before any work, which the tests of `storage` show."""
    (tmp_path / "thesis.tex").write_text("mine")
    words = [word.replace("INPUT", str(given)) for word in COMMANDS[name]]
    assert main([*words, "--out", str(tmp_path)]) == 2
    what = f"slamgauge: {tmp_path}: exists already, and slamgauge has not made it (it has no {MARK})"
    assert capsys.readouterr() == ("", f"{what}; move it away or give another --out\n")
    assert contents(tmp_path) == {"thesis.tex": b"mine"}


def test_a_later_run_removes_what_earlier_commands_left(given: Path, tmp_path: Path):
    """It removes other estimates, the animation and the truth, but no files of another command or of the user."""
    out, blind = tmp_path / "out", tmp_path / "blind"
    assert main([*COMMANDS["run"][:-1], "ekf,riekf", "--out", str(out)]) == 0
    assert main(["animate", str(out), "--seconds", "1", "--fps", "2"]) == 0
    assert main([*COMMANDS["budget"], "--out", str(out)]) == 0
    assert {"animation.gif", "budget.json", "estimates/riekf.npz", "truth.npz"} < contents(out).keys()
    (out / "notes.txt").write_text("mine")
    blind.mkdir()
    (blind / "recording.npz").write_bytes((given / "recording.npz").read_bytes())
    assert main(["evaluate", str(blind / "recording.npz"), "--estimators", "causal", "--out", str(out)]) == 0
    of_run = ("recording.npz", "metrics.json", "figure.png", "figure.svg", "estimates/causal.npz")
    of_budget = ("budget.json", "budget.png", "budget.svg", "report.html")
    left = {name for name, content in contents(out).items() if content is not None}
    assert left == {*of_run, "trajectories/causal.tum", *of_budget, "notes.txt", MARK}
