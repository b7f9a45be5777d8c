"""No command deletes or overwrites files of others; a file in the way is refused before any work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.manifest import MANIFEST, owned
from tests.reference.command_line import contents
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
    "export": ("export", "INPUT", "--format", "csv"),
    "budget": ("budget", "q1-long-dense", *SHORT, "--runs", "1", "--jobs", "1"),
    "bench": ("bench", "--landmarks", "5", "--estimators", "dead-reckoning"),
    "study": STUDY,
    "sweep": (*STUDY, "--sweep", "association.gate=4,9"),
    "grade": ("grade", "INPUT/class", "--scenario", "INPUT/short.toml", "--runs", "2", "--jobs", "1"),
    "noise": ("noise", "INPUT/recording.npz"),
    "animate": ("animate", "--seconds", "1", "--fps", "2"),
}
# names like those that a command writes
UNLUCKY = (
    *("rays.py", "rays.png.bak", "animation.blend", "figure.tex", "metrics.json~", ".metrics.json.partial"),
    *("estimates/mine.npz", "estimates/ekf.py", "trajectories/gps.tum", "study.sqlite.bak", "summary.txt", "nees.pdf"),
    *("sweep.toml", "optimum/notes", "association.gate=9/nees.tex", "budget.xlsx"),
)
IN_THE_WAY = [
    *(("run", name) for name in ("metrics.json", "truth.npz", "figure.svg", "rays.png", "estimates/ekf.npz")),
    *(("run", name) for name in ("trajectories/ekf.tum", "trajectories/truth.tum", "recording.npz/", "estimates")),
    *(("evaluate", name) for name in ("metrics.json", "rays.svg", "estimates/ekf.npz", "trajectories", "figure.png/")),
    *((name, "report.html") for name in ("run", "study", "budget")),
    *(("import", name) for name in ("recording.npz", "truth.npz")),
    *(("import-csv", name) for name in ("recording.npz", "truth.npz", "recording.toml")),
    *(("export", name) for name in ("start.csv", "odometry.csv", "observations.csv/")),
    *(("budget", name) for name in ("budget.json", "budget.png", "budget.svg")),
    *(("bench", name) for name in ("bench.json", "bench.png", "bench.svg")),
    *(("study", name) for name in ("study.sqlite", "study.sqlite-wal", "summary.json", "ratios.svg", "nees.png/")),
    *(("sweep", name) for name in ("sweep.json", "sweep.png", "association.gate=9/study.sqlite", "association.gate=9")),
    *(("sweep", name) for name in ("association.gate=9/summary.json", "association.gate=4/nis.svg", "optimum")),
    *(("grade", name) for name in ("grades.csv", "submissions", "submissions/dead.md")),
    *(("noise", name) for name in ("noise.json", "noise.png", "noise.svg/")),
    *(("animate", name) for name in ("animation.gif", "animation.mp4", "animation.gif/")),
]
WORK = (  # in this order: a module that is imported later would keep the replacement of the last two
    *("datasets.victoria_park.read_victoria_park", "figures.animation.Scene"),
    *("studies.budget.error_budget", "bench.step_times.run_bench", "studies.study._run_missing"),
    *("grading.grading.grade_folder", "datasets.csv_log.read_csv_log", "storage.csv_folder.write_recording_csv"),
    *("noise.estimation.find_noise", "scoring.comparison.compare_estimators", "scenarios.simulation.simulate_informed"),
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


def put(folder: Path, name: str) -> Path:
    """Write a file of somebody else, or make a folder if its name ends with a slash."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if name.endswith("/"):
        path.mkdir()
    else:
        path.write_bytes(f"{name}: mine".encode())
    return path


@pytest.mark.full  # many program starts
@pytest.mark.parametrize("name", COMMANDS)
def test_files_with_unlucky_names_survive_byte_for_byte(
    name: str, command: Callable[[str, Path], int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """In the current folder (`--out .`), first without and then with files of slamgauge in it."""
    for each in UNLUCKY:
        put(tmp_path, each)
    before = contents(tmp_path)
    monkeypatch.chdir(tmp_path)
    if name == "animate":
        assert command("run", Path()) == 0
    for _ in range(2):
        assert command(name, Path()) == 0
    after = contents(tmp_path)
    assert {each: after[each] for each in before} == before
    assert after.keys() - before.keys() > {MANIFEST}
    assert not owned(tmp_path) & {*UNLUCKY}


@pytest.mark.parametrize(("name", "foreign"), IN_THE_WAY)
def test_files_in_the_way_are_refused_before_any_work(
    name: str,
    foreign: str,
    command: Callable[[str, Path], int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    if name == "animate":
        assert command("run", tmp_path) == 0
    path = put(tmp_path, foreign)
    before = contents(tmp_path)
    capsys.readouterr()
    for work in WORK:
        monkeypatch.setattr(f"slamgauge.compare.{work}", lambda *_, **__: pytest.fail("work was begun"))
    assert command(name, tmp_path) == 2
    remedy = "move it away" if name == "animate" else "move it away or give another --out"
    refusal = f"slamgauge: {path}: exists already, and slamgauge has not written it; {remedy}\n"
    assert capsys.readouterr() == ("", refusal)
    assert contents(tmp_path) == before


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
    """It removes other estimates, the animation and the truth, but no files of another command."""
    out, blind = tmp_path / "out", tmp_path / "blind"
    assert main([*COMMANDS["run"][:-1], "ekf,riekf", "--out", str(out)]) == 0
    for name in ("animate", "budget"):
        assert command(name, out) == 0
    assert {"animation.gif", "budget.json", "estimates/riekf.npz", "truth.npz"} < owned(out)
    blind.mkdir()
    (blind / "recording.npz").write_bytes((given / "recording.npz").read_bytes())
    assert main(["evaluate", str(blind / "recording.npz"), "--estimators", "causal", "--out", str(out)]) == 0
    of_run = ("recording.npz", "metrics.json", "figure.png", "figure.svg", "estimates/causal.npz")
    of_budget = ("budget.json", "budget.png", "budget.svg", "report.html")
    expected = {*of_run, "trajectories/causal.tum", *of_budget}
    assert owned(out) == expected
    assert {name for name, data in contents(out).items() if data is not None} == {*expected, MANIFEST}


@pytest.mark.parametrize("name", ["study", "sweep"])
def test_no_store_is_written_through_a_link(
    name: str, command: Callable[[str, Path], int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    place = {"study": "study.sqlite", "sweep": "association.gate=9"}[name]
    (out / place).parent.mkdir(parents=True)
    (out / place).symlink_to(elsewhere / "study.sqlite" if name == "study" else elsewhere)
    assert command(name, out) == 2
    assert f"{out / place}: exists already, and slamgauge has not written it" in capsys.readouterr().err
    assert list(elsewhere.iterdir()) == []
