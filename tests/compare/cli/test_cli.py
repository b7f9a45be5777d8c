"""The command line: what each command writes and prints."""

from __future__ import annotations

import json
import math
import re
import shutil
import webbrowser
from importlib.metadata import version
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from slamgauge import __version__
from slamgauge.compare.cli import doctor
from slamgauge.compare.cli.main import COMMANDS
from slamgauge.compare.estimators.registry import BOUNDS
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth
from slamgauge.compare.storage.staged_folder import MARK
from tests.kernels import compile_kernels
from tests.reference.command_line import SHORT, metrics_of, run

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
DATA = ROOT / "../shared/data"
STEPS = 150
SCENARIOS = sorted(path.stem for path in (ROOT / "compare/scenarios").glob("*.toml"))
SHIPPED = ("ekf", "riekf", "causal", "batch")


def printed_by(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    """Return what a command prints with --json."""
    capsys.readouterr()
    assert run(*arguments, "--json") == 0
    return json.loads(capsys.readouterr().out)


# --- scenarios and help ------------------------------------------------------------------------


def test_scenarios_are_listed(capsys: pytest.CaptureFixture[str]):
    assert run("scenarios") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == SCENARIOS
    entries = printed_by(capsys, "scenarios")
    assert [[entry["name"], entry["description"]] for entry in entries] == [line.split(maxsplit=1) for line in lines]


def help_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as caught:
        run(*words, "--help")
    assert caught.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example_and_options_in_groups(command: str, capsys: Any):
    """That pages name options which exist is in `tests/test_commands_of_pages.py`."""
    text = help_of(capsys, command)
    assert re.search(rf"^  slamgauge {command} ?", text, re.MULTILINE)
    parts = re.split(r"(?m)^\W*((?:\S+ )?options)\W*$", text)[1:]
    sizes = [len(re.findall(r"(?m)^\W* --", part)) for part in parts[1::2]]
    assert max(sizes) <= 10
    if command in ("run", "evaluate", "bench"):  # they refuse bounds
        assert "gtsam-batch" in text
        assert not [name for name in BOUNDS if re.search(rf"(?<![\w-]){name}(?![\w-])", text)]
    assert f"  {command}" in help_of(capsys)


# --- run and evaluate --------------------------------------------------------------------------


def test_run_writes_every_file(stored: Path):
    names = {str(path.relative_to(stored)) for path in stored.rglob("*") if path.is_file()}
    records = ("recording.npz", "truth.npz", "metrics.json", "trajectories/truth.tum")
    each = [file for name in SHIPPED for file in (f"estimates/{name}.npz", f"trajectories/{name}.tum")]
    assert names == {MARK, "report.html", "figure.png", "figure.svg", *records, *each}
    assert [path.name for path in stored.parent.iterdir()] == ["run"]
    truth, recording = load_truth(stored / "truth.npz"), load_recording(stored / "recording.npz")
    assert truth.poses is not None
    assert len(truth.poses) == recording.steps + 1 == STEPS + 1
    for name in SHIPPED:
        poses = load_estimate(stored / f"estimates/{name}.npz").poses
        np.testing.assert_array_equal(np.loadtxt(stored / f"trajectories/{name}.tum")[:, 1:3], poses[:, :2])


def test_metrics_have_every_value_that_exists_and_their_provenance(stored: Path):
    """None stands for a value that an estimator cannot have."""
    metrics = metrics_of(stored)
    assert (metrics["scenario"], metrics["seed"], metrics["truth"]) == ("q1-long-sparse", 3, True)
    assert metrics["version"] == __version__
    assert metrics["command"].startswith("slamgauge run q1-long-sparse --set trajectory.duration=15")
    assert "[trajectory]" in metrics["scenario_text"]
    entries = metrics["estimators"]
    assert [entries[name]["kind"] for name in SHIPPED] == ["filtered", "filtered", "filtered", "smoothed"]
    assert [len(entries[name]["loop_closure"]) for name in SHIPPED] == [1] * 4
    empty = {
        name: {key for key, value in entries[name].items() if value is None} - {"verdict", "rays"} for name in SHIPPED
    }
    assert empty["ekf"] == empty["riekf"] == {"optimum_check_sigma", "chi_square_per_dof"}
    assert empty["causal"] == {"nis_per_dof"}
    assert empty["batch"] == {"nis_per_dof", "yardstick_check_sigma", "optimum_check_sigma"}


@pytest.mark.usefixtures("empty_pictures")
def test_run_prints_a_table_and_writes_notes_on_standard_error(
    tmp_path: Path, stored: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    arguments = ("run", "q1-long-sparse", "--set", SHORT[0], "--set", *SHORT[1:], "--estimators", "dead-reckoning, ekf")
    assert run(*arguments) == 0
    printed = capsys.readouterr()
    begins = [line.split()[0] for line in printed.out.splitlines() if line[0] != " "]
    assert begins == ["estimator", "dead-reckoning", "ekf", "One"]
    command = f"slamgauge study q1-long-sparse --runs 100 --estimators 'dead-reckoning, ekf' --set {' '.join(SHORT)}"
    assert command in " ".join(map(str.strip, printed.out.splitlines()))
    assert printed.err == "written to results/q1-long-sparse-seed-0\n"
    metrics = printed_by(capsys, *arguments)
    assert metrics == metrics_of(tmp_path / "results/q1-long-sparse-seed-0")
    assert metrics["digest"] != metrics_of(stored)["digest"]  # the seed is another one


@pytest.mark.usefixtures("empty_pictures")
def test_the_page_is_opened_with_open(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or len(opened) == 1)
    arguments = ("evaluate", stored / "recording.npz", "--estimators", "ekf", "--out", tmp_path / "a page")
    assert run(*arguments, "--no-report", "--open") == 0
    assert run(*arguments, "--open") == 0
    assert run(*arguments, "--open") == 0
    assert opened == [(tmp_path / "a page" / "report.html").as_uri()] * 2
    assert capsys.readouterr().err.endswith(f"no browser was found; open {tmp_path / 'a page' / 'report.html'}\n")


def test_evaluate_without_truth_has_no_errors(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    shutil.copy(stored / "recording.npz", tmp_path)
    arguments = ("evaluate", tmp_path / "recording.npz", "--estimators", "riekf,causal")
    blind = printed_by(capsys, *arguments)
    needs_truth = ("ate_m", "nees_pose", "landmark_rmse_m", "wrong_associations", "ratio_to_optimum")
    found = blind["estimators"]["riekf"]
    assert [blind["truth"], *(found[key] for key in needs_truth)] == [False, *[None] * 5]
    (closure,) = found["loop_closure"]
    assert closure["error_before_m"] is closure["error_after_m"] is None
    assert closure["sigma_after_m"] < closure["sigma_before_m"]
    assert found["mahalanobis_to_optimum"] > 0
    seeing = printed_by(capsys, *arguments, "--truth", stored / "truth.npz")
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
def test_user_code_gets_a_row(stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "mine.py").write_text(OWN)
    chosen = ("--estimators", f"dead-reckoning,causal,mine={tmp_path}/mine.py:estimate")
    assert run("evaluate", stored / "recording.npz", *chosen, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr()
    rows = [line.split()[:2] for line in printed.out.splitlines()[1:4]]
    assert rows == [[name, "filtered"] for name in ("dead-reckoning", "causal", "mine")]
    kept, written = printed.err.splitlines()
    assert kept.startswith("slamgauge: mine: what it prints is kept in ")
    assert Path(kept.rpartition(" in ")[2]).read_text() == "estimating\n"
    assert written == f"written to {tmp_path / 'out'}"
    entries = metrics_of(tmp_path / "out")["estimators"]
    assert entries["mine"]["ate_m"] == pytest.approx(entries["dead-reckoning"]["ate_m"], rel=1e-9)
    assert (entries["mine"]["nees_pose"], entries["mine"]["seconds_total"] > 0) == (None, True)


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
    assert scores["path"]["nees_pose"] is scores["path"]["seconds_total"] is None
    assert run("evaluate", stored / "recording.npz", "--estimators", "", "--estimates", "gone=none.csv") == 2
    assert capsys.readouterr().err == f"slamgauge: {line}\n"


# --- recordings without ids --------------------------------------------------------------------


@pytest.mark.usefixtures("empty_pictures")
def test_recordings_without_ids(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """What `run` writes, and the associations of `evaluate`; those of graphs are in `tests/compare/estimators`."""
    compile_kernels()
    folder = tmp_path / "out"
    words = ("--estimators", "ekf,causal@ekf", "--set", "trajectory.duration=6", "--no-report", "--out", folder)
    assert run("run", "q2-long-dense", *words) == 0
    assert load_recording(folder / "recording.npz").landmark is None
    assert load_truth(folder / "truth.npz").association is not None
    mapped = [metrics_of(folder)["estimators"]["ekf"]["landmarks_mapped"]]
    for option in ("gate=1", "gate=9", "method=jcbb"):
        words = ("evaluate", folder / "recording.npz", "--estimators", "ekf", "--set", f"association.{option}")
        mapped.append(printed_by(capsys, *words)["estimators"]["ekf"]["landmarks_mapped"])
    assert mapped[1] > mapped[2] == mapped[0] > mapped[3]
    for options, refusal in {
        "association.gate=0": "association.gate: 0.0 is out of range; choose it above 0",
        "association.gat=9": "association.gat: unknown key; did you mean gate?",
        "motion.slip=1": "motion: not a setting of stored recordings; give association.method=jcbb",
    }.items():
        assert run("evaluate", folder / "recording.npz", "--set", options) == 2
        assert capsys.readouterr().err == f"slamgauge: set: {refusal}\n"


# --- doctor --------------------------------------------------------------------------------------


def test_doctor_prints_versions_and_findings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    found = printed_by(capsys, "doctor")
    assert found["slamgauge"].startswith(f"{__version__}, ")
    assert {name: found[name] for name in doctor.LIBRARIES} == {name: version(name) for name in doctor.LIBRARIES}
    assert "OPENBLAS_NUM_THREADS=3" in found["threads"]
    parts = {"BLAS": "numpy: ", "filter kernels": "ready in ", "graph kernels": "ready in ", "machine code": " files, "}
    assert not [name for name, part in parts.items() if part not in found[name]]


def test_doctor_has_a_line_for_a_missing_or_broken_library(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(doctor.LIBRARIES, "no-such-library", doctor.MISSING)
    monkeypatch.setattr("slamgauge.graph_baseline.causal", Mock(side_effect=ImportError("libx.so:\nwrong ELF class")))
    assert run("doctor") == 1
    lines = {"no-such-library  missing", "graph kernels   broken: ImportError: libx.so: wrong ELF class"}
    assert lines < {*capsys.readouterr().out.splitlines()}


# --- real recordings ---------------------------------------------------------------------------


@pytest.mark.full  # real recordings of 6968 and 12608 steps
@pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not there")
@pytest.mark.parametrize(
    ("words", "note"),
    [
        (("victoria-park", "victoria_park/victoria_park.txt"), "6968 steps, 3640 observations, no ground truth"),
        (("lost-in-the-woods", "lost_in_the_woods/dataset2.mat"), "12608 steps, 58135 observations, with ground"),
    ],
)
def test_real_recordings(words: tuple[str, str], note: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run("import", words[0], DATA / words[1], "--out", tmp_path / "log") == 0
    assert note in capsys.readouterr().err
    log = ("evaluate", tmp_path / "log/recording.npz", "--estimators", "ekf,riekf,batch", "--no-report", "--out")
    found = printed_by(capsys, *log, tmp_path / "run")["estimators"]
    if note.endswith("no ground truth"):
        ends = {name: load_estimate(tmp_path / f"run/estimates/{name}.npz").poses[-1, :2] for name in found}
        assert math.dist(ends["riekf"], ends["batch"]) < 0.1
        assert math.dist(ends["ekf"], ends["batch"]) > 2.0
    else:
        assert found["batch"]["ate_m"] <= 0.033
        assert found["riekf"]["ate_m"] <= 0.035 < found["ekf"]["ate_m"]
