"""Grades of a folder of submissions: all forms, all reasons for no grade, written files, and Gradescope."""

from __future__ import annotations

import csv
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge import simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.requests import Address
from slamgauge.compare.grading import grading
from slamgauge.compare.grading.grades import figure_remarks, grade
from slamgauge.compare.grading.rubric import load_rubric
from slamgauge.compare.grading.trial import Trial, run_trial
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.studies.store import digest
from slamgauge.compare.studies.study_run import run_seed
from tests.reference.fast_commands import studies_in_a_thread

from ..scoring.test_error_bounds import scores

pytestmark = pytest.mark.slow

RUBRIC = load_rubric()
ROOT = Path(__file__).parents[3]
STUDENT, WRONG = (
    (ROOT / f"examples/student_ekf{end}.py").read_text(encoding="utf-8") for end in ("", "_wrong_jacobian")
)
OWN_NOISE = "\nfrom slamgauge import adapters\nestimate = adapters.step_function(ekf_slam, noise='file')\n"
SHIFTED = """
import numpy as np
from slamgauge import Estimate, chain

def estimate(recording):
    poses = chain(recording.prior_mean, recording.odometry)
    if recording.odometry[0, 0] == FIRST or FIRST == 0:
        poses = np.concatenate([poses[1:], poses[-1:]])
    return Estimate("filtered", poses)
"""
CLASS = {
    "student_ekf.py": STUDENT,
    "student_ekf_wrong_jacobian.py": WRONG,
    "package/__init__.py": "from .core import ekf_slam\n",
    "package/core.py": STUDENT,
    "several/main.py": "from other import ekf_slam\n",
    "several/other.py": STUDENT,
    "own_noise.py": STUDENT + OWN_NOISE,
    "shifted.py": SHIFTED.replace("FIRST", "0"),
    "broken.py": "def estimate(recording)\n",
    "a.b.py": "",
    "_helper.py": "1 / 0",
    "notes.txt": "",
}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "little.toml"
    path.write_text('extends = "q1-short-dense"\n\n[trajectory]\nduration = 6.0\n')
    return path


def graded_class(folder: Path, scenario: Path, files: Mapping[str, str], *words: str) -> int:
    """Write submissions and grade them into the folder `out`; return the exit status."""
    (folder / "class").mkdir()
    for name, content in files.items():
        (folder / "class" / name).parent.mkdir(exist_ok=True)
        (folder / "class" / name).write_text(content)
    command = ("grade", folder / "class", "--scenario", scenario, "--out", folder / "out", "--jobs", "1", *words)
    with studies_in_a_thread():
        return main([*map(str, command)])


@pytest.fixture(scope="module")
def graded(scenario: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of results of these submissions."""
    folder = tmp_path_factory.mktemp("graded")
    assert graded_class(folder, scenario, CLASS, "--runs", "3", "--seed", "0") == 1
    return folder / "out"


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
    assert "<h1>student_ekf_wrong_jacobian: FAILED, " in page and "the Jacobian F of the prediction" in page
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
    assert (shifted["score"], shifted["max_score"]) == (0, 100) and "uses the future" in shifted["output"]
    assert copied["extra_data"]["remarks"] == ["same figures as package, several"]
    visible = json.dumps({key: value for key, value in copied.items() if key != "extra_data"})
    assert "same figures" not in visible + (graded / "submissions/student_ekf.html").read_text()


def test_all_graded_is_status_0_and_json_has_the_rows(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = ("--runs", "2", "--seed", "7", "--reference", f"right={ROOT}/examples/student_ekf.py:ekf_slam", "--json")
    assert graded_class(tmp_path, scenario, {"anna.py": STUDENT, "bert.py": WRONG}, *words) == 0
    content = json.loads(capsys.readouterr().out)
    assert [(each["submission"], each["passed"]) for each in content] == [("anna", True), ("bert", False)]
    assert {(each["seed"], each["digest"]) for each in content} == {(7, digest(load_scenario(scenario), 7))}
    assert content[0]["ate_ratio"] == 1.0  # the reference is the same filter


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no memory limit")
def test_the_middle_run_is_checked_and_too_much_memory_is_a_reason(scenario: Path, tmp_path: Path):
    middle = simulate(load_scenario(scenario), run_seed(0, 1))[1].odometry[0, 0]
    files = {
        "greedy.py": "import numpy as np\n\ndef estimate(recording):\n    return np.ones(6_000_000_000)\n",
        "in_the_middle.py": SHIFTED.replace("FIRST", repr(float(middle))),
        "right.py": STUDENT,
    }
    assert graded_class(tmp_path, scenario, files, "--runs", "3", "--seed", "0") == 1
    reasons = {name: row["reason"] for name, row in rows(tmp_path / "out").items()}
    assert reasons["right"] == "" and reasons["in_the_middle"].startswith("run 1: uses the future: ")
    assert "MemoryError: Unable to allocate 44.7 GiB" in reasons["greedy"]
    assert reasons["greedy"].endswith("; its process may take 4 GB")


@pytest.mark.parametrize(
    ("files", "words", "message"),
    [
        ({}, (), "contains no submission; give a folder of Python files"),
        ({"a.py": "X = 1 / 0"}, (), "nothing could be graded; a: cannot be loaded, it raised ZeroDivisionError"),
        ({"a.py": ""}, ("--runs", "1"), "runs: 1 has no interval"),
        ({"a.py": ""}, ("--reference", "efk"), "estimator 'efk' is not known"),
        ({"a/x.py": "", "a/y.py": ""}, (), "a: may be x.py, y.py; call the one that counts submission.py"),
    ],
)
def test_errors_are_one_line_and_status_2(
    scenario: Path, tmp_path: Path, files: dict[str, str], words: tuple[str, ...], message: str, capsys: Any
):
    assert graded_class(tmp_path, scenario, files, "--runs", "2", *words) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("slamgauge: ") and message in error
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("empty_pictures")
def test_an_error_of_slamgauge_costs_one_submission_its_grade(
    scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its name and the error are neither a formula in grades.csv nor HTML on its pages."""

    def fails_for_anna(where: Address, name: str, *rest: Any) -> Trial:
        if name == "=anna":
            raise ZeroDivisionError("<b>zero</b>")
        return run_trial(where, name, *rest)

    monkeypatch.setattr(grading, "run_trial", fails_for_anna)
    files = {"=anna.py": STUDENT, "bert.py": STUDENT, "deep.py": f"x = {'-' * 100_000}1"}
    assert graded_class(tmp_path, scenario, files, "--runs", "2", "--seed", "0") == 1
    found = rows(tmp_path / "out")
    assert found["bert"]["passed"] == "true"
    reason = found["'=anna"]["reason"]
    assert re.fullmatch(r"ZeroDivisionError: <b>zero</b> \(test_grading.py, line \d+; a defect of .*\)", reason)
    assert found["deep"]["reason"].startswith("cannot be loaded, it raised ")
    for page in ("submissions/=anna.html", "report.html"):
        text = (tmp_path / "out" / page).read_text()
        assert "&lt;b&gt;zero&lt;/b&gt;" in text and "<b>zero" not in text


def test_grades_of_scores():
    """Figures that are not finite are missing; errors below the optimum's and smoothed poses do not pass."""
    theirs = scores(ate=1.0, spread=0.1)
    found = grade("mine", Trial(scores=theirs), theirs, RUBRIC)
    assert found.to_json()["ate_m"] == pytest.approx(1.0, abs=0.1)
    row = replace(found, figures={"ate_m": Interval(math.inf, math.nan, None)}).to_json()
    assert (row["ate_m"], row["ate_m_low"], row["ate_m_high"]) == (None, None, None)
    ours = scores(ate=0.5, spread=0.1)
    for check, passes in ((None, False), (9.0, True)):  # an optimum in doubt proves nothing
        more = {"ratio_to_optimum": 0.5, "yardstick_check_sigma": check, "seconds_total": 1.0}
        relative = [replace(each, figures={**each.figures, **more}) for each in ours]
        found = grade("mine", Trial(scores=relative), ours, RUBRIC)
        assert found.passed == passes
        assert passes or found.reasons[0].startswith("its error is 0.5 ± ")
    smoothed = [replace(each, figures={**each.figures, "kind": "smoothed"}) for each in theirs]
    reasons = grade("mine", Trial(scores=smoothed), theirs, RUBRIC).reasons
    assert reasons[0] == "its poses are smoothed; filtered poses are required"


def test_identical_figures_are_named_on_both_sides():
    one, other = scores(ate=1.0, spread=0.1), scores(ate=1.0 + 1e-12, spread=0.1)
    runs = {"anna": one, "bert": other, "carl": [*one], "dora": [], "emil": [], "(ekf)": other}
    assert figure_remarks(runs, "(ekf)") == {
        "(ekf)": ["same figures as bert"],
        "anna": ["same figures as carl"],
        "carl": ["same figures as anna"],
        "bert": ["same figures as the reference (ekf)"],
    }


@pytest.mark.full  # tests/compare/estimators has the noise of files
def test_other_noise_of_a_file_is_graded_too(scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A square is missing in its Q: with the noise of the file it is more cautious."""
    recording = simulate(load_scenario(scenario), 0)[1]
    dt = recording.stamps[1] - recording.stamps[0]
    Q, Py = np.diag(recording.odometry_cov[0])[[0, 2]] / dt**2, np.diag(recording.observation_cov[0])
    noise = f"\nQ = np.diag({np.sqrt(Q).tolist()})\nPy = np.diag({Py.tolist()})\nDT = {dt}\n"
    words = ("--runs", "3", "--seed", "0", "--json")
    assert graded_class(tmp_path, scenario, {"root.py": STUDENT + noise}, *words) == 0
    (root,) = json.loads(capsys.readouterr().out)
    assert root["settings"].startswith("Q of the file, diag(") and "a square is missing" in root["settings"]
    assert 0.8 < root["own_noise_nees_ratio"] / root["nees_ratio"] < 0.97
    assert root["points"] == 100  # they count the noise of the recording
    page = (tmp_path / "out/submissions/root.html").read_text()
    assert "NEES x, own noise" in page and "<li>Q of the file, diag(" in page


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Gradescope's image is Linux")
@pytest.mark.parametrize("name", ["mine", pytest.param("submission", marks=pytest.mark.full)])
def test_the_autograder_of_the_examples(scenario: Path, tmp_path: Path, name: str):
    for folder in ("source", "submission"):
        (tmp_path / folder).mkdir()
    (tmp_path / "source/rubric.toml").write_text("total = 20\n")
    (tmp_path / f"submission/{name}.py").write_text(STUDENT if name == "submission" else "X = 1 / 0\n")
    settings = {f"AUTOGRADER_{key.upper()}": str(tmp_path / key) for key in ("source", "submission", "results")}
    settings |= {"SLAMGAUGE_SCENARIO": str(scenario), "SLAMGAUGE_RUNS": "2"}
    settings |= {"SLAMGAUGE_BIN": str(Path(sys.executable).parent)}
    command = [str(ROOT / "examples/gradescope/run_autograder")]
    ran = subprocess.run(command, env={**os.environ, **settings}, capture_output=True, text=True, check=True)
    found = json.loads((tmp_path / "results/results.json").read_text())
    if name == "mine":
        error = "nothing could be graded; submission: cannot be loaded, it raised ZeroDivisionError"
        assert found["score"] == 0 and found["output"].startswith(error)
        return
    assert (found["score"], found["max_score"], found["extra_data"]["passed"]) == (20, 20, True)
    assert {each["status"] for each in found["tests"]} == {"passed"}
    assert "root seed" in ran.stdout and "1 of 1 graded, 1 passed" in ran.stdout
