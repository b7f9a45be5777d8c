"""A filter that is lost by its own innovations says so at the step where it shows; one that is not says nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from slamgauge import load_scenario, simulate
from slamgauge.ekf import AssociatingFilter, BearingFilter, CompressedFilter, SlamFilter
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings import Association, Rays
from slamgauge.notices import tell_once
from slamgauge.recording import Observations

START = np.zeros(3), np.eye(3) * 1e-12
SIGMA = 1e-3  # m, of what is seen
MAKE: dict[str, Callable[[], OnlineFilter]] = {
    "fej-ekf": lambda: SlamFilter("position", *START, "first-estimates"),
    "riekf": lambda: AssociatingFilter("position", *START, "right-invariant", Association(gate=1e12)),
    "the filter": lambda: CompressedFilter("position", *START, 5.0),
}


@pytest.fixture(autouse=True)
def notices_anew() -> Iterator[None]:
    tell_once.cache_clear()
    yield
    tell_once.cache_clear()


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if " kernels " not in line]


def lost(name: str) -> str:
    return f"slamgauge: {name} has lost itself: its NIS is 10000 times what noise explains; raise the sensor's noise"


@pytest.mark.parametrize("name", MAKE)
def test_it_is_said_at_the_step_where_it_shows(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    slam = MAKE[name]()
    for seen_at in (3.0, 3.0, 3.0 + SIGMA):
        slam.update(Observations(np.array([7]), np.array([[seen_at, 1.0]]), np.eye(2)[None] * SIGMA**2))
    assert said(capsys) == []
    for seen_at in (4.0, 3.0):
        slam.update(Observations(np.array([7]), np.array([[seen_at, 1.0]]), np.eye(2)[None] * SIGMA**2))
    assert said(capsys) == [lost(name)]


@pytest.mark.parametrize(("sigma", "notices"), [(5.0, []), (3e-4, [lost("ekf")])])
def test_so_it_is_with_bearings_alone(sigma: float, notices: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    changed = [f"sensor.sigma_bearing_deg={sigma}", "trajectory.duration=30"]
    truth, recording = simulate(load_scenario("q4-three-landmarks", changed), 0)
    rays = Rays(alpha=0.3, beta=2.0, s_min=1.0)  # four members, of which the first is close by
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, initialisation=rays)
    for _ in drive(slam, recording):
        pass
    assert said(capsys) == notices
    assert truth.poses is not None
    assert (np.hypot(*(slam.pose - truth.poses[-1])[:2]) > 100.0) == bool(notices)  # m
