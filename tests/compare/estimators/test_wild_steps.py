"""Files in the style of the exercise and of PythonRobotics run unedited, and their replaced settings are named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import slamgauge
from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.estimators.loading import LoadedEstimator, load, load_estimators
from slamgauge.compare.estimators.requests import ask, with_noise_and_form
from slamgauge.compare.estimators.running import run_side_by_side
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.simulation import simulate
from slamgauge.ekf import ekf_slam
from tests.reference import wild_steps

from .conftest import short

pytestmark = pytest.mark.slow

Loaded = Callable[..., LoadedEstimator]


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Loaded:
    """Return a function that loads the only estimator of a file with that source."""
    monkeypatch.chdir(tmp_path)

    def load_it(source: str) -> LoadedEstimator:
        Path("mine.py").write_text(source)
        return load_estimators(["mine=mine.py"])["mine"]

    return load_it


@pytest.mark.parametrize(
    ("source", "scenario", "bounds"),
    [
        (wild_steps.COLUMNS, "q1-short-dense", (0.95, 1.05)),
        (wild_steps.PARAMETERS, "q1-short-dense", (0.95, 1.05)),
        (wild_steps.OWN_ASSOCIATION, "q1-short-dense", (0.75, 1.25)),
        (wild_steps.ROBOTICS, "q1-short-dense", (0.75, 1.25)),
        (wild_steps.ONE_NOISE, "q1-short-dense", (0.75, 1.25)),
        (wild_steps.RAYS, "q4-ring", (0.95, 1.05)),
    ],
    ids=["columns", "parameters", "own association", "PythonRobotics", "PythonRobotics, one noise", "rays"],
)
def test_the_error_of_a_right_file_relative_to_that_of_ekf(
    mine: Loaded, source: str, scenario: str, bounds: tuple[float, float]
):
    """The bounds are those of issue 39: 5 %, and 25 % with association by the file."""
    errors: list[list[float]] = []
    estimator = mine(source)
    settings = load_scenario(scenario, ["start=sampled", "trajectory.duration=20"])
    for seed in range(6):
        truth, recording = simulate(settings, seed)
        scores = [slamgauge.evaluate(truth, recording, each(recording))["ate_m"] for each in (estimator, ekf_slam)]
        errors.append([each for each in scores if each is not None])
    own, ours = np.mean(errors, axis=0)
    assert bounds[0] < own / ours < bounds[1]


def test_matrices_of_numpy_have_their_product(mine: Loaded):
    recording = short("q1-short-dense", "trajectory.duration=2")
    arrays, matrices = (mine(source)(recording) for source in (wild_steps.ROBOTICS, wild_steps.MATRICES))
    assert np.allclose(arrays.poses, matrices.poses, rtol=0.0, atol=1e-9)


def test_converted_numbers_and_replaced_settings_are_named_once(mine: Loaded):
    recording = short()
    estimator = mine(wild_steps.COLUMNS.replace("DT = 0.1", "DT = 0.2"))
    ran = run_side_by_side({"mine": estimator}, recording, recording)
    found = ran.remarks["mine"]
    assert found[:3] == [
        "DT of the file, 0.2 s, is replaced by the recording's, 0.1 s",
        "Q of the file, diag(0.25, 0.04), is replaced by the recording's, diag(0.09, 0.00274)",
        "Py of the file, diag(0.09, 0.04), is replaced by the recording's, diag(0.01, 0.00762)",
    ]
    refused = [each for each in found if "its arrays of one element are converted to numbers" in each]
    assert len(refused) == 1  # numpy refuses lists that mix numbers and arrays, before 2.4 too
    assert len(found) == 4


@pytest.mark.parametrize("name", ["Q", "Py"])
def test_a_missing_square_is_named(mine: Loaded, name: str):
    recording = short()
    right = {"Q": "np.diag([0.3, np.deg2rad(3.0)])", "Py": "np.diag([0.1, np.deg2rad(5.0)])"}
    source = wild_steps.COLUMNS + "".join(f"{each} = {value} ** 2\n" for each, value in right.items())
    estimator = mine(source)
    estimator(recording)
    assert not any("of the file" in each for each in estimator.remarks(recording))
    estimator = mine(f"{source}{name} = {right[name]}\n")
    estimator(recording)
    (found,) = [each for each in estimator.remarks(recording) if "of the file" in each]
    assert found.startswith(f"{name} of the file, diag(")
    assert found.endswith(": it has standard deviations, a square is missing")


def test_the_noise_of_the_file_is_used_and_named(mine: Loaded):
    """A missing square in the file changes the estimate of its own noise, not that of the recording's."""
    recording = short()
    mine(f"{wild_steps.COLUMNS}Q = 0.1 * np.eye(2)\n")
    asked = with_noise_and_form(ask(["ekf", "mine=mine.py"]), "both")
    assert [each.label for each in asked] == ["ekf", "mine", "mine (own noise)"]
    assert asked[1].key != asked[2].key
    given, own = (load(each) for each in asked[1:])
    covs = [np.asarray(each(recording).pose_covs)[-1, 0, 0] for each in (given, own)]
    assert covs[1] > 1.1 * covs[0]
    assert any(each.startswith("assumes Q of the file, diag(0.1, 0.1), where") for each in own.remarks(recording))


def test_own_association_gets_no_ids(mine: Loaded):
    recording = short()
    source = wild_steps.OWN_ASSOCIATION.replace(
        "    A, B = move", "    assert not KNOWN_DATA_ASSOCIATION and (y[:, 2] == -1).all()\n    A, B = move"
    )
    estimator = mine(source)
    estimate = estimator(recording)
    assert (len(estimate.landmark_ids), estimate.association) == (0, None)
    assert "associates on its own and gets no ids, since KNOWN_DATA_ASSOCIATION is 0" in estimator.remarks(recording)[0]
    known = mine(wild_steps.COLUMNS)
    known(short("q2-short-dense"))
    expected = "KNOWN_DATA_ASSOCIATION of the file, 1, is replaced by 0: the recording has no ids"
    assert known.remarks(recording)[0] == expected


def test_noise_of_the_pose_and_its_gate_are_replaced_or_kept(mine: Loaded):
    """The file has the error of a filter with the recording's noise, or of one with its own."""
    recording = short("q1-short-dense", "trajectory.duration=2")
    own, given = "Cx of the file, diag(0.25, 0.25, 0.274)", "diag(0.0009, 0, 2.74e-05) (body frame)"
    for source, name in ((wild_steps.ROBOTICS, "R"), (wild_steps.ONE_NOISE, "Cx[0:2, 0:2]")):
        estimator = mine(source)
        (with_own,) = with_noise_and_form(ask(["mine=mine.py"]), "file")
        kept = load(with_own)
        sigmas = [np.sqrt(np.asarray(each(recording).pose_covs)[-1, 0, 0]) for each in (estimator, kept, ekf_slam)]
        assert 0.9 < sigmas[0] / sigmas[2] < 1.1
        assert sigmas[1] > 2.0 * sigmas[2]
        remarks = estimator.remarks(recording)
        assert f"{own}, is replaced by the recording's, {given}" in remarks
        assert f"{name} of the file, diag(0.25, 0.25), is replaced by the recording's, diag(0.01, 0.00762)" in remarks
        assert (
            "M_DIST_TH of the file, 2.0, is replaced by 13.8: that of the file fits its Cx, which is replaced"
            in remarks
        )
        assert f"assumes {own}, where the recording has {given}" in kept.remarks(recording)
        assert not any("M_DIST_TH of the file" in each for each in kept.remarks(recording))


def test_noise_under_other_names_is_kept_and_named(mine: Loaded):
    recording = short("q1-short-dense", "trajectory.duration=2")
    estimator = mine(wild_steps.ROBOTICS.replace("Cx", "noise"))
    estimator(recording)
    expected = "noise of its own, R = diag(0.25, 0.25), noise = diag(0.25, 0.25, 0.274): the file has no Q and no Py"
    assert expected in estimator.remarks(recording)


@pytest.mark.parametrize(
    ("bug", "failed"),
    [
        (None, set[str]()),
        ("sign", {"prediction-jacobian"}),
        ("wrap", {"innovation-wrap"}),
        ("cross", {"cross-covariance"}),
    ],
)
def test_checks_name_a_seeded_bug(mine: Loaded, bug: str | None, failed: set[str]):
    source = wild_steps.COLUMNS
    if bug is not None:
        right, wrong = wild_steps.BUGS[bug]
        assert source.count(right) == 1
        source = source.replace(right, wrong)
    assert {each.name for each in check_estimator("mine", mine(source), 0, CHECKS) if each.is_failure} == failed


def test_a_requested_form_is_used_or_refused(mine: Loaded):
    mine(wild_steps.COLUMNS)
    for form, message in (
        ("octave", r"ekf_slam\(xEst, PEst, u, y\) has not the form octave; give prediction_step"),
        ("other", "no form is named 'other'; use one of ntnu-class, "),
    ):
        (asked,) = with_noise_and_form(ask(["mine=mine.py"]), "recording", form)
        with pytest.raises(slamgauge.UserError, match=f"^estimator mine: {message}"):
            load(asked)
    (asked,) = with_noise_and_form(ask(["mine=mine.py"]), "recording", "step")
    assert load(asked)(short()).kind == "filtered"
