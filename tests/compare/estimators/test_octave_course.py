"""Translations of the Octave course: the convention of a file is found, and a right file is as good as `ekf`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.estimators.adapters import found_in
from slamgauge.compare.estimators.forms.form import remarks_of
from slamgauge.compare.estimators.forms.octave_conventions import CourseObservation, CourseScan
from slamgauge.compare.estimators.forms.probing import LANDMARKS, ORDER, right_poses, tiny_recording
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.estimators.sources import sources_of
from slamgauge.compare.estimators.user_code import Address
from slamgauge.compare.grading.submissions import submissions_in
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator
from slamgauge.se2 import wrap
from tests.reference.course_files import STYLES, Style

from .conftest import agree, short

pytestmark = pytest.mark.slow

REFERENCE = "dicts from 1"


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def loaded(place: str, source: str = "") -> Estimator:
    """Load the estimator at `place`, FILE.py:callable, after its source is written."""
    if source:
        Path(place.partition(":")[0]).write_text(source)
    return load_estimators([f"mine={place}"])["mine"]


def split(style: Style) -> None:
    """Write the two functions of a style into two files."""
    at = style.source.index(f"def {style.correct}")
    head = style.source[: style.source.index(f"def {style.predict}")]
    Path("prediction_step.py").write_text(style.source[:at])
    Path("correction_step.py").write_text(head + style.source[at:])


@pytest.mark.parametrize("name", STYLES)
def test_a_file_of_each_style_is_the_same_filter(name: str):
    """The styles differ in the arguments alone; the convention of each is found."""
    recording = short("freiburg-course", "trajectory.duration=12")
    style = STYLES[name]
    estimator = loaded(f"mine.py:{style.predict}", style.source)
    estimate = estimator(recording)
    assert remarks_of(estimator, recording) == [f"the course's functions take {style.words}"]
    again = loaded(f"mine.py:{style.correct}", style.source)(recording)
    reference = loaded("other.py:prediction_step", STYLES[REFERENCE].source)(recording)
    agree(estimate, reference, atol=1e-9)
    agree(again, reference, atol=1e-9)
    assert len(estimate.landmark_ids) > 3


def test_a_global_number_of_landmarks_is_set_to_that_of_the_state():
    """Files of the course have the nine landmarks of its log as a global."""
    recording = short("freiburg-course", "trajectory.duration=12")
    source = STYLES[REFERENCE].source
    assert "np.eye(len(mu))" in source
    mine = loaded("mine.py:prediction_step", "N = 9\n" + source.replace("np.eye(len(mu))", "np.eye(2 * N + 3)"))
    estimate = mine(recording)
    agree(estimate, loaded("other.py:prediction_step", source)(recording), atol=1e-12)
    count = len(estimate.landmark_ids)
    assert 3 < count < 9
    remark = f"N of the file, 9, is replaced by the recording's, the landmarks observed so far ({count} at the end)"
    assert remarks_of(mine, recording)[1:] == [remark]


def ate(poses: Float, truth: Float | None) -> float:
    assert truth is not None
    return float(np.sqrt(np.mean(np.sum((poses[:, :2] - truth[:, :2]) ** 2, axis=1))))


def test_with_the_noise_of_the_course_a_right_file_equals_ekf_until_a_scan_has_old_and_new_landmarks():
    """In such a scan, first at step 5, the file linearises new landmarks before the update; ekf maps them after it."""
    truth, recording = simulate(load_scenario("freiburg-course"), 0)
    recording = recording.first(4)
    mine = loaded("mine.py:prediction_step", STYLES[REFERENCE].source)(recording)
    reference = ekf_slam(recording)
    assert np.allclose(mine.poses, reference.poses, rtol=0.0, atol=2e-3)
    assert np.allclose(np.asarray(mine.pose_covs), np.asarray(reference.pose_covs), rtol=0.0, atol=1e-3)
    assert truth.poses is not None
    assert np.abs(reference.poses[4] - truth.poses[4]).max() > 0.02


def test_with_the_noise_of_the_course_a_right_file_has_the_error_of_ekf():
    """Over 8 runs the ratio of the errors is 0.99; that of 40 runs is 1.07, with a standard error of 0.03."""
    estimator = loaded("mine.py:prediction_step", STYLES[REFERENCE].source)
    errors: list[tuple[float, float]] = []
    for seed in range(8):
        truth, recording = simulate(load_scenario("freiburg-course"), seed)
        mine, reference = estimator(recording), ekf_slam(recording)
        errors.append((ate(mine.poses, truth.poses), ate(reference.poses, truth.poses)))
    assert 0.8 < float(np.divide(*np.mean(errors, axis=0))) < 1.25


@pytest.mark.parametrize("place", ["prediction_step.py:prediction_step", "correction_step.py:correction_step"])
def test_the_second_function_is_found_in_a_neighbour(place: str):
    style, recording = STYLES["dicts from 1"], short()
    split(style)
    agree(loaded(place)(recording), loaded("one.py:prediction_step", style.source)(recording), atol=0.0)


def test_a_main_script_may_import_both_functions():
    style, recording = STYLES["list of ids, in place"], short()
    split(style)
    main = "from prediction_step import *\nfrom correction_step import correction_step\n"
    agree(
        loaded("main.py:correction_step", main)(recording),
        loaded("one.py:prediction_step", style.source)(recording),
        atol=0.0,
    )


def found(file: str, strangers: tuple[str, ...] = ()) -> str:
    path = Path(file).resolve()
    where = Address(path.name, path.stem, str(path), "", sources_of(path.parent, path.stem), strangers)
    return found_in(where).attribute


@pytest.mark.parametrize("name", STYLES)
def test_the_functions_are_found_without_a_name(name: str):
    Path("mine.py").write_text(STYLES[name].source)
    assert found("mine.py") == STYLES[name].predict


def test_one_function_is_found_without_a_name_if_a_neighbour_has_the_other():
    split(STYLES[REFERENCE])
    assert found("prediction_step.py") == "prediction_step"
    assert found("correction_step.py") == "correction_step"
    assert {name for name, _ in sources_of(Path.cwd(), "correction_step").files} == {
        "prediction_step.py",
        "correction_step.py",
    }
    with pytest.raises(UserError, match="defines no callable of a form that is known"):
        found("prediction_step.py", strangers=("correction_step",))


def test_a_folder_with_the_two_functions_is_one_submission(tmp_path: Path):
    split(STYLES[REFERENCE])
    Path("tools.py").write_text("def normalize(angle): ...\n")
    folder = tmp_path / "all" / "ada"
    folder.mkdir(parents=True)
    for file in tmp_path.glob("*.py"):
        file.rename(folder / file.name)
    (submission,) = submissions_in(tmp_path / "all")
    assert submission.reason == ""
    assert submission.where is not None
    assert found_in(submission.where).attribute == "correction_step"


def test_of_two_neighbours_with_the_function_neither_is_taken():
    split(STYLES[REFERENCE])
    Path("one.py").write_text(Path("correction_step.py").read_text())
    Path("correction_step.py").rename("two.py")
    with pytest.raises(UserError, match="defines no callable of a form that is known"):
        found("prediction_step.py")


def test_predict_and_update_remain_a_form_of_their_own(capsys: pytest.CaptureFixture[str]):
    Path("correct.py").write_text("def correct(mu, sigma, z, observed): ...\n")
    Path("mine.py").write_text("def predict(eta, P, z_odo): ...\ndef update(eta, P, z): ...\n")
    assert found("mine.py") == "predict"
    loaded("mine.py:update")
    assert "mine: functions predict (eta, P, z_odo) and update (eta, P, z)\n" in capsys.readouterr().err


def test_a_file_that_fits_no_convention_is_one_line_with_its_own_line():
    source = STYLES[REFERENCE].source.replace("z[i]['range']", "z[i]['distance']")
    with pytest.raises(UserError) as caught:
        loaded("mine.py:prediction_step", source)(short())
    line = str(caught.value)
    assert "\n" not in line
    assert "fits none of 312 known ways to call it; nearest to one, it raised AttributeError" in line
    number = 1 + source[: source.index("z[i]['distance']")].count("\n")
    assert f"(mine.py, line {number})" in line


def test_prints_of_the_search_are_not_shown(capsys: pytest.CaptureFixture[str]):
    source = STYLES[REFERENCE].source.replace("    m = len(z)\n", "    print('called')\n    m = len(z)\n")
    recording = short()
    loaded("mine.py:prediction_step", source)(recording)
    assert capsys.readouterr().out.count("called") == len(np.unique(recording.observation_step))


def test_the_tiny_recording_keeps_to_its_answer():
    recording = tiny_recording(0.1)
    assert recording.landmark is not None
    at = right_poses()[recording.observation_step]
    ways = LANDMARKS[recording.landmark] - at[:, :2]
    assert np.allclose(np.hypot(*ways.T), recording.observation[:, 0])
    assert np.allclose(wrap(np.arctan2(ways[:, 1], ways[:, 0]) - at[:, 2]), recording.observation[:, 1])
    assert [*dict.fromkeys(recording.landmark.tolist())] == ORDER
    assert np.allclose(ekf_slam(recording).poses, right_poses(), atol=1e-9)


def test_a_scan_is_read_by_observation_field_and_element():
    z = CourseScan([CourseObservation(2, 3.0, 0.5), CourseObservation(1, 4.0, -0.5)])
    assert z[1].range == z["range"][1] == z.range[1] == z[1, 1] == 4.0
    assert (z.shape, z["id"].tolist()) == ((2, 3), [2, 1])
    with pytest.raises(AttributeError):
        _ = z.distance
