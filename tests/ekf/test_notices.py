"""Notices of a filter: that it has diverged, at the step that shows it; that the iterated filter did not settle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from slamgauge import load_scenario, simulate
from slamgauge.ekf import AssociatingFilter, BearingFilter, SlamFilter
from slamgauge.ekf.estimators import drive
from slamgauge.ekf.kernels.update import PASSES
from slamgauge.ekf.online_filter import OnlineFilter
from slamgauge.ekf.settings import Association, Rays
from slamgauge.recording import Observations

pytestmark = pytest.mark.usefixtures("no_notices_yet")

START = np.zeros(3), np.eye(3) * 1e-12
SIGMA = 1e-3  # m, noise of observations
MAKE: dict[str, Callable[[], OnlineFilter]] = {
    "fej-ekf": lambda: SlamFilter("position", *START, "first-estimates"),
    "riekf": lambda: AssociatingFilter("position", *START, "right-invariant", Association(gate=1e12)),
}


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if " kernels " not in line]


def lost(name: str) -> str:
    return f"slamgauge: {name} has diverged: its NIS is over 10000 times its degrees of freedom; raise sensor noise"


@pytest.mark.parametrize("name", MAKE)
def test_the_notice_is_printed_at_the_step_that_shows_divergence(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    slam = MAKE[name]()
    for seen_at in (3.0, 3.0, 3.0 + SIGMA):
        slam.update(Observations(np.array([7]), np.array([[seen_at, 1.0]]), np.eye(2)[None] * SIGMA**2))
    assert said(capsys) == []
    for seen_at in (4.0, 3.0):
        slam.update(Observations(np.array([7]), np.array([[seen_at, 1.0]]), np.eye(2)[None] * SIGMA**2))
    assert said(capsys) == [lost(name)]


@pytest.mark.parametrize(("sigma", "notices"), [(5.0, []), (3e-4, [lost("ekf")])])
def test_a_bearing_filter_prints_the_notice_only_if_it_diverges(
    sigma: float, notices: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    changed = ["start=mean", f"sensor.sigma_bearing_deg={sigma}", "trajectory.duration=30"]
    truth, recording = simulate(load_scenario("q4-three-landmarks", changed), 0)
    rays = Rays(alpha=0.3, beta=2.0, s_min=1.0)  # four members, the first nearby
    slam = BearingFilter(recording.prior_mean, recording.prior_cov, initialisation=rays)
    for _ in drive(slam, recording):
        pass
    assert said(capsys) == notices
    assert truth.poses is not None
    assert (np.hypot(*(slam.pose - truth.poses[-1])[:2]) > 100.0) == bool(notices)  # m


def test_an_iterated_update_that_does_not_settle_is_reported_once(capsys: pytest.CaptureFixture[str]) -> None:
    slam = SlamFilter("position", *START, "iterated")
    sight = Observations(np.array([7]), np.array([[3.0, 1.0]]), np.eye(2)[None])
    for _ in range(2):
        slam.update(sight)
    assert said(capsys) == []
    slam.map.update_kernels = (slam.map.update_kernels[0], lambda *_: (1.0, 2, PASSES))
    for _ in range(2):
        assert slam.update(sight) == (1.0, 2)
    notice = "iekf: an update did not settle in 1000 passes, and the last one is used; raise the sensor noise"
    assert said(capsys) == [f"slamgauge: {notice}"]
