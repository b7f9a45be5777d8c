"""Grades of a folder of submissions: all forms, all reasons for no grade, and the written files."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge import load_scenario, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.requests import Address
from slamgauge.compare.grading import grading
from slamgauge.compare.grading.grades import grade
from slamgauge.compare.grading.rubric import load_rubric
from slamgauge.compare.grading.trial import Trial, run_trial
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.scoring.scores import Score
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import run_seed
from tests.reference.fast_commands import studies_in_a_thread

from ..scoring.test_error_bounds import scores

pytestmark = pytest.mark.slow

RUBRIC = load_rubric()
EXAMPLES = Path(__file__).parents[3] / "examples"
SCENARIO = 'extends = "q1-short-dense"\n\n[trajectory]\nduration = 6.0\n'
SHIFTED_IN_RUN = """
import numpy as np
from slamgauge import Estimate, chain

def estimate(recording):
    poses = chain(recording.prior_mean, recording.odometry)
    if recording.steps == 60 and recording.odometry[0, 0] == FIRST:
        poses = np.concatenate([poses[1:], poses[-1:]])
    return Estimate("filtered", poses)
"""
GREEDY = """
import numpy as np

def estimate(recording):
    return np.ones(6_000_000_000)
"""
SHIFTED = """
import numpy as np
from slamgauge import Estimate, chain

def estimate(recording):
    poses = chain(recording.prior_mean, recording.odometry)
    return Estimate("filtered", np.concatenate([poses[1:], poses[-1:]]))
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "little.toml"
    path.write_text(SCENARIO)
    return path


def write_class(folder: Path) -> None:
    """Write submissions of several forms."""
    for name in ("student_ekf", "student_ekf_wrong_jacobian"):
        shutil.copy(EXAMPLES / f"{name}.py", folder)
    (folder / "package").mkdir()
    (folder / "package/__init__.py").write_text("from .core import ekf_slam\n")
    shutil.copy(EXAMPLES / "student_ekf.py", folder / "package/core.py")
    (folder / "several").mkdir()
    (folder / "several/main.py").write_text("from other import ekf_slam\n")
    shutil.copy(EXAMPLES / "student_ekf.py", folder / "several/other.py")
    own_noise = "\nfrom slamgauge import adapters\nestimate = adapters.step_function(ekf_slam, noise='file')\n"
    (folder / "own_noise.py").write_text((EXAMPLES / "student_ekf.py").read_text() + own_noise)
    (folder / "shifted.py").write_text(SHIFTED)
    (folder / "broken.py").write_text("def estimate(recording)\n")
    (folder / "a.b.py").write_text("")
    (folder / "_helper.py").write_text("1 / 0")
    (folder / "notes.txt").write_text("")


@pytest.fixture(scope="module")
def graded(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of results of these submissions."""
    folder, out = tmp_path_factory.mktemp("class"), tmp_path_factory.mktemp("out") / "grades"
    write_class(folder)
    words = ["--scenario", str(scenario), "--runs", "3", "--seed", "0", "--out", str(out)]
    with studies_in_a_thread():
        assert main(["grade", str(folder), *words]) == 1
    return out


def rows(out: Path) -> dict[str, dict[str, str]]:
    with (out / "grades.csv").open(encoding="utf-8", newline="") as file:
        return {row["submission"]: row for row in csv.DictReader(file)}


def test_every_form_is_graded_and_other_files_have_a_reason(graded: Path):
    found = rows(graded)
    right = {"student_ekf", "package", "several", "own_noise"}
    assert {name for name, row in found.items() if row["passed"] == "true"} == right
    assert {name for name, row in found.items() if row["graded"] == "true"} == right | {"student_ekf_wrong_jacobian"}
    reasons = {name: row["reason"] for name, row in found.items() if row["reason"]}
    assert "fails the check prediction-jacobian" in reasons.pop("student_ekf_wrong_jacobian")
    assert reasons.pop("shifted").startswith("run 0: uses the future: from the recording up to step ")
    assert reasons.pop("broken").startswith("cannot be loaded, it raised SyntaxError: expected ':' (broken.py, line 1)")
    assert reasons == {"a.b": "a.b.py: no Python module can have a dot in its name; rename the file"}


def test_a_right_filter_agrees_with_the_reference(graded: Path):
    row = rows(graded)["student_ekf"]
    assert [*row][:3] == ["submission", "passed", "reason"]
    assert (row["callable"], row["kind"], row["runs"], row["failed_checks"]) == ("ekf_slam", "filtered", "3", "")
    assert row["form"] == "step function of the exercise (xEst, PEst, u, y)"
    for key in ("ate_ratio", "nees_ratio", "sigma_position_ratio", "sigma_heading_ratio"):
        assert float(row[key]) == pytest.approx(1.0, abs=0.03)
        assert float(row[f"{key}_low"]) <= float(row[key]) <= float(row[f"{key}_high"])


def test_pages_and_files_of_submissions(graded: Path):
    page = (graded / "submissions/student_ekf_wrong_jacobian.html").read_text()
    assert "<h1>student_ekf_wrong_jacobian: FAILED, " in page
    assert "the Jacobian F of the prediction" in page
    own = (graded / "submissions/own_noise.html").read_text()
    assert "not judged: it ignores the odometry noise of the recording" in own
    assert "<h1>broken: not graded, 0 of 100 points</h1>" in (graded / "submissions/broken.html").read_text()
    assert (graded / "rubric.toml").read_text() == RUBRIC.to_toml()
    files = {"grades.csv", "gradescope", "rubric.toml", "submissions", "report.html", ".slamgauge.json"}
    assert {path.name for path in graded.iterdir()} == files


def test_results_for_gradescope_have_points_per_item_and_hide_remarks_from_students(graded: Path):
    results = {path.parent.name: json.loads(path.read_text()) for path in graded.glob("gradescope/*/results.json")}
    assert results.keys() == rows(graded).keys()
    wrong, copied, shifted = (results[name] for name in ("student_ekf_wrong_jacobian", "student_ekf", "shifted"))
    tests = {each["name"]: each for each in wrong["tests"]}
    assert (tests["prediction-jacobian"]["score"], tests["prediction-jacobian"]["status"]) == (0, "failed")
    assert re.match(r"[\d.e-]+ instead of at most 0.001: the Jacobian F", tests["prediction-jacobian"]["output"])
    assert tests["truth-recovered"]["score"] == tests["truth-recovered"]["max_score"] > 6
    assert wrong["score"] == pytest.approx(sum(each["score"] for each in wrong["tests"]), abs=0.1)
    assert (shifted["score"], shifted["max_score"]) == (0, 100)
    assert "uses the future" in shifted["output"]
    assert copied["extra_data"]["remarks"] == ["same figures as package, several"]
    visible = json.dumps({key: value for key, value in copied.items() if key != "extra_data"})
    assert "same figures" not in visible + (graded / "submissions/student_ekf.html").read_text()


@pytest.mark.usefixtures("studies_in_a_thread")
def test_all_graded_is_status_0_and_json_has_the_rows(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "class").mkdir()
    shutil.copy(EXAMPLES / "student_ekf.py", tmp_path / "class/anna.py")
    shutil.copy(EXAMPLES / "student_ekf_no_cross_covariance.py", tmp_path / "class/bert.py")
    words = ["--scenario", str(scenario), "--runs", "2", "--seed", "7"]
    words += ["--reference", f"right={EXAMPLES}/student_ekf.py:ekf_slam"]
    assert main(["grade", str(tmp_path / "class"), *words, "--jobs", "1", "--json", "--out", str(tmp_path / "o")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [(each["submission"], each["passed"]) for each in content] == [("anna", True), ("bert", False)]
    assert {(each["seed"], each["digest"]) for each in content} == {(7, digest(load_scenario(str(scenario)), 7))}
    assert content[0]["ate_ratio"] == 1.0  # the reference is the same filter


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no memory limit")
@pytest.mark.usefixtures("studies_in_a_thread")
def test_the_middle_run_is_checked_and_too_much_memory_is_a_reason(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "class").mkdir()
    _, middle = simulate(load_scenario(str(scenario)), run_seed(0, 1))
    shifted = SHIFTED_IN_RUN.replace("FIRST", repr(float(middle.odometry[0, 0])))
    for name, source in {"greedy": GREEDY, "in_the_middle": shifted}.items():
        (tmp_path / f"class/{name}.py").write_text(source)
    shutil.copy(EXAMPLES / "student_ekf.py", tmp_path / "class/right.py")
    words = ["--scenario", str(scenario), "--runs", "3", "--seed", "0", "--out", str(tmp_path / "out"), "--json"]
    assert main(["grade", str(tmp_path / "class"), *words]) == 1
    reasons = {each["submission"]: each["reason"] for each in json.loads(capsys.readouterr().out)}
    assert reasons["right"] == ""
    assert reasons["in_the_middle"].startswith("run 1: uses the future: ")
    assert "MemoryError: Unable to allocate 44.7 GiB" in reasons["greedy"]
    assert reasons["greedy"].endswith("; its process may take 4 GB")


@pytest.mark.usefixtures("studies_in_a_thread")
@pytest.mark.parametrize(
    ("files", "words", "said"),
    [
        ({}, (), "contains no submission; give a folder of Python files"),
        ({"a.py": "X = 1 / 0"}, (), "nothing could be graded; a: cannot be loaded, it raised ZeroDivisionError"),
        ({"a.py": ""}, ("--runs", "1"), "runs: 1 has no interval"),
        ({"a.py": ""}, ("--reference", "efk"), "estimator 'efk' is not known"),
        ({"a.py": ""}, ("--timeout", "0"), "timeout: 0 s leaves no time"),
        ({"a.py": ""}, ("--seed", "-1"), "seed: -1 is negative"),
        ({"a/x.py": "", "a/y.py": ""}, (), "a: may be x.py, y.py; call the one that counts submission.py"),
    ],
)
def test_errors_are_one_line_and_status_2(
    scenario: Path,
    tmp_path: Path,
    files: dict[str, str],
    words: tuple[str, ...],
    said: str,
    capsys: pytest.CaptureFixture[str],
):
    folder = tmp_path / "class"
    folder.mkdir()
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(content)
    command = ["grade", str(folder), "--scenario", str(scenario), "--runs", "2", "--out", str(tmp_path / "out"), *words]
    assert main(command) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("slamgauge: ") and said in error
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_an_error_of_slamgauge_costs_one_submission_its_grade(
    scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its name and the error are neither a formula in grades.csv nor HTML on its pages."""
    (tmp_path / "class").mkdir()
    for name in ("=anna", "bert"):
        shutil.copy(EXAMPLES / "student_ekf.py", tmp_path / f"class/{name}.py")
    (tmp_path / "class/deep.py").write_text(f"x = {'-' * 100_000}1")

    def fails_for_anna(where: Address, name: str, *rest: Any) -> Trial:
        if name == "=anna":
            raise ZeroDivisionError("<b>zero</b>")
        return run_trial(where, name, *rest)

    monkeypatch.setattr(grading, "run_trial", fails_for_anna)
    out = tmp_path / "out"
    words = ["--scenario", str(scenario), "--runs", "2", "--seed", "0", "--jobs", "1", "--out", str(out)]
    assert main(["grade", str(tmp_path / "class"), *words]) == 1
    found = rows(out)
    assert found["bert"]["passed"] == "true"
    reason = found["'=anna"]["reason"]
    assert re.fullmatch(r"ZeroDivisionError: <b>zero</b> \(test_grading.py, line \d+; a defect of .*\)", reason)
    assert found["deep"]["reason"].startswith("cannot be loaded, it raised ")
    for page in ("submissions/=anna.html", "report.html"):
        assert "&lt;b&gt;zero&lt;/b&gt;" in (out / page).read_text()
        assert "<b>zero" not in (out / page).read_text()


def test_figures_that_are_not_finite_are_missing():
    theirs = scores(ate=1.0, spread=0.1)
    found = grade("mine", Trial(scores=theirs), theirs, RUBRIC)
    assert found.to_json()["ate_m"] == pytest.approx(1.0, abs=0.1)
    row = replace(found, figures={"ate_m": Interval(math.inf, math.nan, None)}).to_json()
    assert (row["ate_m"], row["ate_m_low"], row["ate_m_high"]) == (None, None, None)


def test_errors_below_those_of_the_optimum_do_not_pass():
    ours = scores(ate=0.5, spread=0.1)
    relative = [_relative(each, other["ate_m"]) for each, other in zip(ours, scores(ate=1.0, spread=0.1), strict=True)]
    found = grade("mine", Trial(scores=relative), ours, RUBRIC)
    assert not found.passed
    assert found.reasons[0].startswith("its error is 0.5 ± ")
    doubtful = [_relative(each, 1.0, check=9.0) for each in ours]
    assert grade("mine", Trial(scores=doubtful), ours, RUBRIC).passed


def test_smoothed_poses_do_not_pass_if_the_reference_is_filtered():
    theirs = scores(ate=1.0, spread=0.1)
    smoothed = [with_figures(each, kind="smoothed") for each in theirs]
    reasons = grade("mine", Trial(scores=smoothed), theirs, RUBRIC).reasons
    assert reasons[0] == "its poses are smoothed; filtered poses are required"


def with_figures(score: Score, **figures: object) -> Score:
    return replace(score, figures={**score.figures, **figures})


def _relative(score: Score, best: float | None, check: float | None = None) -> Score:
    assert score["ate_m"] is not None and best is not None
    return with_figures(score, ratio_to_optimum=score["ate_m"] / best, yardstick_check_sigma=check, seconds_total=1.0)


@pytest.mark.full  # tests/compare/estimators has this
@pytest.mark.usefixtures("studies_in_a_thread")
def test_no_file_of_the_folder_hides_a_library_from_the_others(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "class").mkdir()
    for name in ("anna", "numpy", "random"):
        shutil.copy(EXAMPLES / "student_ekf.py", tmp_path / f"class/{name}.py")
    with (tmp_path / "class/anna.py").open("a") as file:
        file.write("\nimport random\n\nrandom.seed(1)\n")
    words = ["--scenario", str(scenario), "--runs", "2", "--jobs", "1", "--out", str(tmp_path / "out")]
    assert main(["grade", str(tmp_path / "class"), *words]) == 0
    assert capsys.readouterr().out.endswith("3 of 3 graded, 3 passed\n")


@pytest.mark.full  # tests/compare/estimators has the noise of files
@pytest.mark.usefixtures("studies_in_a_thread")
def test_other_noise_of_a_file_is_graded_too_and_the_same_noise_is_not(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """A square is missing in the Q of `root`: with the noise of the file it is more cautious."""
    (tmp_path / "class").mkdir()
    recording = simulate(load_scenario(str(scenario)), 0)[1]
    dt = recording.stamps[1] - recording.stamps[0]
    Q, Py = np.diag(recording.odometry_cov[0])[[0, 2]] / dt**2, np.diag(recording.observation_cov[0])
    source = (EXAMPLES / "student_ekf.py").read_text()
    for name, own in {"same": Q, "root": np.sqrt(Q)}.items():
        noise = f"\nQ = np.diag({own.tolist()})\nPy = np.diag({Py.tolist()})\nDT = {dt}\n"
        (tmp_path / f"class/{name}.py").write_text(source + noise)
    words = ["--scenario", str(scenario), "--runs", "3", "--seed", "0", "--jobs", "1", "--out", str(tmp_path / "out")]
    assert main(["grade", str(tmp_path / "class"), *words, "--json"]) == 0
    root, same = json.loads(capsys.readouterr().out)
    assert (same["settings"], same["own_noise_ate_ratio"]) == ("", None)
    assert root["settings"].startswith("Q of the file, diag(")
    assert "a square is missing" in root["settings"]
    assert 0.8 < root["own_noise_nees_ratio"] / root["nees_ratio"] < 0.97
    assert root["points"] == same["points"] == 100  # they count the noise of the recording
    assert root["remarks"] == "same figures as same"
    page = (tmp_path / "out/submissions/root.html").read_text()
    assert "NEES x, own noise" in page
    assert "<li>Q of the file, diag(" in page
