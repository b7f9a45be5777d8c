"""Choice of the compressed filter for large maps, and equality with the full filter."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from slamgauge.ekf import CompressedFilter, FilterSettings, SlamFilter, estimators, riekf
from slamgauge.ekf.advanced.area_radius import area_that_pays, work
from slamgauge.ekf.estimators import drive, online_filter
from slamgauge.ekf.maps.correction_table import CORRECTIONS, Correction
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording

pytestmark = [pytest.mark.usefixtures("no_notices_yet"), pytest.mark.slow]


def along_a_road(landmarks: int, near: float, stride: float) -> Recording:
    """Return a drive along a straight road and back, half a metre per landmark; the range is `near` [m]."""
    there = np.arange(0.0, 0.5 * landmarks, stride)
    x = np.concatenate([there, there[::-1]])
    heading = np.repeat([0.0, np.pi], len(there))
    odometry = np.column_stack([np.abs(np.diff(x)), np.zeros(len(x) - 1), np.diff(heading)])
    places = np.column_stack([0.5 * np.arange(landmarks), np.where(np.arange(landmarks) % 2, 1.0, -1.0)])
    step, landmark = np.nonzero(np.abs(x[:, None] - places[:, 0]) < near)
    dx, dy = places[landmark, 0] - x[step], places[landmark, 1]
    rng = np.random.default_rng(0)
    polar = np.column_stack([np.hypot(dx, dy), np.arctan2(dy, dx) - heading[step]])
    return Recording(
        stamps=np.arange(len(x), dtype=np.float64),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([0.01, 0.01, 1e-4]),
        odometry=odometry,
        odometry_cov=np.tile(np.diag([1e-4, 1e-6, 1e-6]), (len(odometry), 1, 1)),
        sensor="range-bearing",
        observation_step=step,
        observation=polar + rng.normal(0.0, 0.01, polar.shape),
        observation_cov=np.tile(np.diag([1e-4, 1e-4]), (len(step), 1, 1)),
        landmark=landmark,
    )


def chosen(recording: Recording, correction: str = "ekf") -> type:
    return type(online_filter(recording, CORRECTIONS[correction], FilterSettings()))


@pytest.mark.parametrize("name", ["ekf", "riekf"])
def test_a_long_road_uses_compressed_updates_and_prints_a_notice(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    recording = along_a_road(400, 3.0, 0.02)
    assert chosen(recording, name) is CompressedFilter
    assert capsys.readouterr().err == (
        f"slamgauge: 400 landmarks: {name} uses compressed updates (CompressedFilter): the same result in less time\n"
    )
    assert {chosen(recording, other) for other in CORRECTIONS if other not in ("ekf", "riekf")} == {SlamFilter}


def test_the_larger_cost_of_the_right_invariant_filter_is_included() -> None:
    recording = along_a_road(400, 3.0, 0.02)
    full, standard = work(recording, "standard", 4.5)
    same, invariant = work(recording, "right-invariant", 4.5)
    assert same == full > invariant > standard


def test_small_areas_and_maps_of_one_area_use_the_full_filter() -> None:
    assert chosen(along_a_road(400, 3.0, 0.5)) is SlamFilter
    assert chosen(along_a_road(310, 200.0, 5.0)) is SlamFilter
    assert area_that_pays(along_a_road(100, 3.0, 0.02), "standard") is None


def test_large_scans_with_frequent_changes_of_area_use_the_full_filter() -> None:
    """The compressed filter takes 1.6 times as long here."""
    assert area_that_pays(along_a_road(800, 3.0, 0.1), "standard") is None


@pytest.mark.parametrize(("name", "estimator"), [("ekf", estimators.ekf_slam), ("riekf", riekf)])
def test_the_estimate_equals_the_full_filter(name: str, estimator: Estimator, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = along_a_road(60, 3.0, 0.3)
    full = estimator(recording)

    def always(recording: Recording, _: Correction) -> float:
        return float(recording.observation[:, 0].max())

    monkeypatch.setattr("slamgauge.ekf.estimators.area_that_pays", always)
    assert chosen(recording, name) is CompressedFilter
    estimate = estimator(recording)
    for what in ("poses", "pose_covs", "landmarks", "landmark_covs", "nis"):
        np.testing.assert_allclose(getattr(estimate, what), getattr(full, what), atol=1e-9, err_msg=what)


def beyond_the_covariance(landmarks: int) -> float:
    """Return the peak memory of the compressed filter on a road, without its covariance, in bytes."""
    recording = along_a_road(landmarks, 3.0, 0.5)
    tracemalloc.start()
    slam = CompressedFilter("range-bearing", recording.prior_mean, recording.prior_cov, 4.5)
    slam.reserve(landmarks)
    for _ in drive(slam, recording):
        pass
    assert slam.landmark_covs.shape == (landmarks, 2, 2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - 8.0 * (3 + 2 * landmarks) ** 2


def test_the_compressed_filter_needs_little_beyond_the_covariance() -> None:
    """Twice the map, twice the memory: the filter makes no copy of the covariance."""
    beyond_the_covariance(20)  # loads kernels
    few, more, most = (beyond_the_covariance(landmarks) for landmarks in (50, 100, 200))
    assert 0.0 < few < more < most < 2.5 * more


def test_lack_of_memory_is_reported_before_work_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = along_a_road(20, 3.0, 0.5)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 1e3)
    for estimator, what in ((riekf, "covariance"), (batch, "batch"), (causal, "causal")):
        with pytest.raises(UserError, match=rf"{what} of 20 landmarks.* GB are free"):
            estimator(recording)
