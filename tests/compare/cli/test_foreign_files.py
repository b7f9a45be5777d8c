"""No command writes into a folder of somebody else; it is refused before any work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.staged_folder import MARK
from tests.reference.robot_logs import CSV

pytestmark = [pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures"), pytest.mark.slow]

PARK = "ODOMETRY 0 1 1 0 0.5 1e-4 0 0 4e-6 0 4e-6\nLANDMARK 0 2 6 8 0.4 0 0.4\n"
SHORT = ("--set", "trajectory.duration=3")
STUDY = ("study", "q2-long-dense", *SHORT, "--runs", "1", "--jobs", "1", "--estimators", "ekf,causal")
COMMANDS = {
    "run": ("run", "q1-short-dense", *SHORT, "--estimators", "ekf"),
    "evaluate": ("evaluate", "INPUT/recording.npz", "--estimators", "ekf"),
    "import": ("import", "victoria-park", "INPUT/park.txt"),
    "import-csv": ("import", "csv", "INPUT/log"),
    "export": ("export", "csv", "INPUT"),
    "budget": ("budget", "q1-long-dense", *SHORT, "--runs", "1", "--jobs", "1"),
    "bench": ("bench", "--landmarks", "5", "--estimators", "dead-reckoning"),
    "study": STUDY,
    "sweep": (*STUDY, "--sweep", "association.gate=4,9"),
    "grade": ("grade", "INPUT/class", "--scenario", "INPUT/short.toml", "--runs", "2", "--jobs", "1", "--unconfined"),
    "noise": ("noise", "INPUT/recording.npz"),
    "animate": ("animate", "--seconds", "1", "--fps", "2"),
}
WORK = (
    *("imports.read_victoria_park", "imports.read_csv_log", "animate.animate", "budget.error_budget"),
    *("bench.run_bench", "grade.grade_folder", "exports.write_recording_csv", "noise.find_noise"),
    *("scoring.compare_estimators", "run.simulate_informed"),
)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the inputs of all commands."""
    folder = tmp_path_factory.mktemp("given") / "input"
    assert main([*COMMANDS["run"], "--out", str(folder)]) == 0
    (folder / "park.txt").write_text(PARK)
    (folder / "log").mkdir()
    for name, text in CSV.items():
        (folder / "log" / name).write_text(text)
    (folder / "short.toml").write_text('extends = "q1-long-dense"\n[trajectory]\nduration = 3.0\n')
    (folder / "class").mkdir()
    (folder / "class/dead.py").write_text("from slamgauge import dead_reckoning as estimate\n")
    return folder


@pytest.fixture
def command(given: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Path], int]:
    """Runs one of COMMANDS in a folder, without ffmpeg."""
    monkeypatch.setenv("PATH", "")

    def call(name: str, out: Path) -> int:
        first, *words = (word.replace("INPUT", str(given)) for word in COMMANDS[name])
        return main([first, str(out), *words] if name == "animate" else [first, *words, "--out", str(out)])

    return call


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "animate"])
def test_folders_of_others_are_refused_before_any_work(
    name: str,
    command: Callable[[str, Path], int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    (tmp_path / "thesis.tex").write_text("mine")
    monkeypatch.setattr("slamgauge.compare.studies.study._run_missing", lambda *_, **__: pytest.fail("work was begun"))
    for work in WORK:
        monkeypatch.setattr(f"slamgauge.compare.cli.{work}", lambda *_, **__: pytest.fail("work was begun"))
    assert command(name, tmp_path) == 2
    what = f"slamgauge: {tmp_path}: exists already, and slamgauge has not made it (it has no {MARK})"
    assert capsys.readouterr() == ("", f"{what}; move it away or give another --out\n")
    assert texts(tmp_path) == {"thesis.tex"}


def texts(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("name", "empty"), [(name, out) for name in COMMANDS for out in (["--out", ""], ["--out="])])
def test_an_empty_path_is_refused(
    name: str,
    empty: list[str],
    given: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    words = [word.replace("INPUT", str(given)) for word in COMMANDS[name]]
    assert main(["animate", ""] if name == "animate" else [*words, *empty]) == 2
    refusal = "slamgauge: '' is an empty path; name a folder, . for the current one\n"
    assert capsys.readouterr() == ("", refusal)
    assert list(tmp_path.iterdir()) == []


def test_a_later_run_removes_what_earlier_commands_left(
    given: Path, command: Callable[[str, Path], int], tmp_path: Path
):
    """It removes other estimates, the animation and the truth, but no files of another command or of the user."""
    out, blind = tmp_path / "out", tmp_path / "blind"
    assert main([*COMMANDS["run"][:-1], "ekf,riekf", "--out", str(out)]) == 0
    for name in ("animate", "budget"):
        assert command(name, out) == 0
    assert {"animation.gif", "budget.json", "estimates/riekf.npz", "truth.npz"} < texts(out)
    (out / "notes.txt").write_text("mine")
    blind.mkdir()
    (blind / "recording.npz").write_bytes((given / "recording.npz").read_bytes())
    assert main(["evaluate", str(blind / "recording.npz"), "--estimators", "causal", "--out", str(out)]) == 0
    of_run = ("recording.npz", "metrics.json", "figure.png", "figure.svg", "estimates/causal.npz")
    of_budget = ("budget.json", "budget.png", "budget.svg", "report.html")
    assert texts(out) == {*of_run, "trajectories/causal.tum", *of_budget, "notes.txt", MARK}
