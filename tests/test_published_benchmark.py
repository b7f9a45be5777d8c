"""The 2D SLAM benchmark of UKF-M: its constants, and its figures in fewer runs than `docs/consistency.md` has."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from slamgauge import Summary, load_scenario, run_study, simulate

pytestmark = pytest.mark.full  # statistics of a published benchmark

PUBLISHED_EKF = {
    "heading_rmse_rad": np.deg2rad(3.02),
    "position_rmse_m": 0.67,
    "nees_position_per_dof": 2.56,
    "nees_heading": 2.88,
}
PUBLISHED_IEKF = {
    "heading_rmse_rad": np.deg2rad(2.51),
    "position_rmse_m": 0.55,
    "nees_position_per_dof": 1.17,
    "nees_heading": 1.01,
}
RUNS = 40


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> Summary:
    folder: Path = tmp_path_factory.mktemp("ukfm")
    with ThreadPoolExecutor(1) as executor:
        return run_study(load_scenario("ukfm-slam2d"), RUNS, 0, ("ekf", "fej-ekf", "riekf"), folder, executor)


def test_the_constants_are_the_published_ones() -> None:
    truth, recording = simulate(load_scenario("ukfm-slam2d"), 0)
    assert recording.steps == 2500
    assert truth.poses is not None
    assert truth.landmarks is not None
    radius = 0.25 / np.deg2rad(1.5)
    np.testing.assert_allclose(np.hypot(*(truth.landmarks - [0.0, radius]).T), radius + 3.0, atol=1e-5)
    assert len(truth.landmarks) == 20
    assert recording.observation_step.min() == 1
    sigma_speed, sigma_yaw_rate = 0.05 * 0.25 / np.sqrt(2), 0.05 * 0.25 * 2 * np.sqrt(2)
    np.testing.assert_allclose(np.diag(recording.odometry_cov[0]), [sigma_speed**2, 0.0, sigma_yaw_rate**2], rtol=1e-12)
    assert not recording.prior_cov.any()
    seen = truth.landmarks[recording.landmark] - truth.poses[recording.observation_step, :2]
    distance = np.hypot(*seen.T)
    assert 1.0 <= distance.min() < distance.max() <= 5.0


@pytest.mark.parametrize(("name", "published"), [("ekf", PUBLISHED_EKF), ("riekf", PUBLISHED_IEKF)])
def test_published_figures_lie_within_the_sampling_error_of_both(
    summary: Summary, name: str, published: dict[str, float]
) -> None:
    """Both means have a sampling error: together sqrt(1 + RUNS / 100) times ours, taken at 99 % instead of 95."""
    widen = np.sqrt(1 + RUNS / 100) * 2.58 / 1.96
    for key, figure in published.items():
        interval = summary.estimators[name][key]
        half = widen * (interval.high - interval.low) / 2
        assert abs(interval.mean - figure) <= half, key


def test_the_textbook_filter_is_inconsistent_and_its_relatives_are_not(summary: Summary) -> None:
    sure, honest = summary.estimators["ekf"]["nees_heading"], summary.estimators["riekf"]["nees_heading"]
    assert sure is not None
    assert sure.low is not None
    assert honest is not None
    assert honest.low is not None
    assert honest.high is not None
    assert honest.low <= 1.0 <= honest.high
    assert sure.low > 1.0
    share = {name: summary.estimators[name]["nees_share_inside_band"] or 0.0 for name in ("ekf", "fej-ekf", "riekf")}
    assert share["ekf"] < 0.5 < 0.98 < min(share["riekf"], share["fej-ekf"])
