"""The textbook EKF: full matrices, comparison with `ekf` on the scenarios of questions 1 and 2, refusals.

`kernels/test_jacobians` has its Jacobians. On random recordings, with correlated noise and position sensors too,
`test_filters_against_textbook` and `test_associating_filter` compare the two.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

from slamgauge import (
    Association,
    Estimate,
    MapManagement,
    UserError,
    ekf_slam,
    load_estimators,
    load_scenario,
    simulate,
)
from slamgauge import textbook_ekf as exported
from slamgauge.arrays import Float
from slamgauge.ekf.settings import FilterSettings
from slamgauge.ekf.textbook import (
    Belief,
    augment,
    linearise,
    locate,
    stack,
    textbook_ekf,
    update,
)
from slamgauge.se2 import wrap
from tests.reference.random_recordings import random_recording, recording_of

X = np.array([0.3, -0.2, 2.9, 1.5, 2.0, -0.6, -3.0])  # a robot that faces backwards, and two landmarks
EQUAL = 1e-9  # largest difference, absolute up to 1 and relative above: sums in another order
FULL = ("q1-short-dense", "q1-long-dense", "q1-long-sparse", "q2-long-sparse")
# steps: the textbook needs seconds for all of them, and minutes for q2-gate-1 (with equal results)
SHORT = {"q2-short-dense": 200, "q2-long-dense": 250, "q2-gate-1": 120, "q2-gate-100": 250}


# --- covariances on full matrices ----------------------------------------------------------------


def random_covariance(size: int) -> Float:
    root = np.random.default_rng(size).normal(size=(size, size))
    return root @ root.T


def test_augmentation_on_full_matrices() -> None:
    P, R, z = random_covariance(7), random_covariance(2), np.array([2.0, 1.5])
    landmark, J_r, J_y = locate("range-bearing", X[:3], z)
    T, noise = np.vstack([np.eye(7), np.eye(2, 7)]), np.zeros((9, 9))
    T[7:, :3], noise[7:, 7:] = J_r, J_y @ R @ J_y.T
    x, augmented, ids = augment("range-bearing", Belief(X, P, (4, 2)), 7, z, R)
    np.testing.assert_array_equal(x, [*X, *landmark])
    np.testing.assert_allclose(augmented, T @ P @ T.T + noise, rtol=0, atol=1e-12)
    assert ids == (4, 2, 7)


def test_the_update_equals_the_joseph_form() -> None:
    P, R = 0.01 * random_covariance(7), 0.01 * np.stack([random_covariance(2), 2 * random_covariance(2)])
    z, slots = np.array([[2.5, 1.3], [2.9, 2.1]]), np.array([0, 1])
    v, H, noise = stack(linearise("position", X, slots, z, R), len(X))
    np.testing.assert_array_equal(noise, block_diag(*R))
    (x, after, _), _, dof = update(Belief(X, P, (4, 2)), v, H, noise)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + noise)
    joseph = (np.eye(7) - K @ H) @ P @ (np.eye(7) - K @ H).T + K @ noise @ K.T
    np.testing.assert_allclose(after, joseph, rtol=0, atol=1e-13)
    expected = X + K @ v
    expected[2] = wrap(expected[2])
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-13)
    assert dof == 4


def test_a_bearing_of_a_landmark_at_the_robot_is_not_used() -> None:
    x = np.array([1.0, 2.0, 0.3, 1.003, 2.0])
    R = np.array([[[0.01, 0.004], [0.004, 0.02]]])
    seen = linearise("range-bearing", x, np.array([0]), np.array([[0.1, 2.0]]), R)
    (_, P, _), nis, dof = update(Belief(x, 0.01 * np.eye(5), (4,)), *stack(seen, len(x)))
    assert dof == 1
    assert nis == pytest.approx((0.1 - 0.003) ** 2 / 0.03)  # S = 0.01 + 0.01 + 0.01
    assert P[2, 2] == 0.01


# --- the fast filter -----------------------------------------------------------------------------


def assert_equal(actual: Estimate, expected: Estimate) -> None:
    for name in ("association", "landmark_ids", "nis_dof"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)
    for name in ("poses", "pose_covs", "landmarks", "landmark_covs", "nis"):
        found, wanted = getattr(actual, name), getattr(expected, name)
        assert (np.abs(found - wanted) <= EQUAL * np.maximum(1.0, np.abs(wanted))).all(), name


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FULL, *SHORT])
def test_ekf_is_the_textbook_ekf_on_questions_1_and_2(name: str) -> None:
    scenario = load_scenario(name, ["start=sampled"])
    _, recording = simulate(scenario, 0)
    recording = recording.first(SHORT.get(name, recording.steps))
    association = scenario.association.settings()
    assert (recording.landmark is None) == name.startswith("q2")
    fast = ekf_slam(recording) if association is None else ekf_slam(recording, FilterSettings(association))
    assert_equal(fast, textbook_ekf(recording, association))


def test_a_new_landmark_that_is_observed_twice_in_a_scan() -> None:
    _, recording = random_recording(2, steps=10)
    repeated = recording.only(np.repeat(np.arange(len(recording.observation)), 2))
    observation = repeated.observation.copy()
    observation[1::2] += np.sqrt(np.diagonal(repeated.observation_cov[1::2], axis1=1, axis2=2))
    repeated = replace(repeated, observation=observation)
    assert_equal(ekf_slam(repeated), textbook_ekf(repeated))


# --- refusals ------------------------------------------------------------------------------------


def test_bearing_only_recordings_are_refused() -> None:
    with pytest.raises(UserError, match=r"^sensor: .*bearing-only landmarks; use ekf, which starts them as rays"):
        textbook_ekf(recording_of("bearing"))


@pytest.mark.parametrize("association", [Association("jcbb"), Association(map_management=MapManagement())])
def test_other_associations_are_refused(association: Association) -> None:
    with pytest.raises(UserError, match=r"^association: .*nearest neighbour without map management only; use ekf$"):
        textbook_ekf(random_recording(0)[1], association)


# --- its name and its program ----------------------------------------------------------------------


def test_the_estimator_textbook_ekf_uses_the_gate_of_the_scenario() -> None:
    assert exported is textbook_ekf
    scenario = load_scenario("q2-gate-100", ["trajectory.duration=5"])
    _, recording = simulate(scenario, 0)
    loaded = load_estimators(["textbook-ekf", "ekf"], association=scenario.association)
    assert_equal(loaded["ekf"](recording), loaded["textbook-ekf"](recording))
    assert len(loaded["ekf"](recording).landmark_ids) < len(textbook_ekf(recording).landmark_ids)  # gate 9


@pytest.mark.slow
def test_the_file_is_a_program_that_draws_a_run(tmp_path: Path) -> None:
    file = Path(__file__).parents[2] / "ekf" / "textbook.py"
    done = subprocess.run([sys.executable, file], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == f"Map and errors: {Path('results/textbook/figure.png')}\n"
    assert (tmp_path / "results/textbook/figure.png").stat().st_size > 10_000
