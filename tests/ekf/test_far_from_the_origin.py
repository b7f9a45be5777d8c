"""Results relative to the start do not depend on the place: robots log UTM positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.ekf import (
    Association,
    Delayed,
    FilterSettings,
    MapManagement,
    Rays,
    dead_reckoning,
    ekf_slam,
    fej_ekf,
    iekf,
    oc_ekf,
    riekf,
)
from slamgauge.estimate import Estimate
from slamgauge.se2 import wrap
from tests.reference.moved_recording import FAR, TOLERANCE, assert_same_positions, moved
from tests.reference.random_recordings import bearing_only, random_recording

FILTERS = pytest.mark.parametrize("estimator", [ekf_slam, fej_ekf, oc_ekf, iekf, riekf])
Estimator = Callable[..., Estimate]


def assert_same(far: Estimate, near: Estimate) -> None:
    assert near.pose_covs is not None
    assert far.pose_covs is not None
    assert_same_positions(far.poses[:, :2], near.poses[:, :2], near.pose_covs[:, :2, :2])
    turned = wrap(far.poses[:, 2] - near.poses[:, 2] - FAR[2])
    assert (np.abs(turned) < TOLERANCE * np.sqrt(near.pose_covs[:, 2, 2])).all()
    np.testing.assert_allclose(
        np.linalg.eigvalsh(far.pose_covs[:, :2, :2]), np.linalg.eigvalsh(near.pose_covs[:, :2, :2]), rtol=TOLERANCE
    )
    if near.nis is None:
        return
    assert far.nis is not None
    np.testing.assert_allclose(far.nis, near.nis, rtol=TOLERANCE, atol=TOLERANCE)
    np.testing.assert_array_equal(far.landmark_ids, near.landmark_ids)
    np.testing.assert_array_equal(far.association, near.association)
    assert near.landmarks is not None
    assert far.landmarks is not None
    assert near.landmark_covs is not None
    assert_same_positions(far.landmarks, near.landmarks, near.landmark_covs)
    if near.history is None or far.history is None:
        assert near.history is far.history
        return
    assert_same_positions(far.history.position, near.history.position, near.history.cov)


@FILTERS
@pytest.mark.parametrize("sensor", ["range-bearing", "position"])
@pytest.mark.parametrize("association", [None, Association(), Association("jcbb", map_management=MapManagement())])
def test_ranges_and_bearings(estimator: Estimator, sensor: str, association: Association | None) -> None:
    _, recording = random_recording(30, sensor=sensor, steps=60, noise=0.5)
    settings = FilterSettings(association or Association(), frames=5)
    if association is not None:
        recording = replace(recording, landmark=None)
    assert_same(estimator(moved(recording), settings), estimator(recording, settings))


@FILTERS
@pytest.mark.parametrize("initialisation", [Rays(), Delayed()])
def test_bearing_only(estimator: Estimator, initialisation: Rays | Delayed) -> None:
    recording = bearing_only(random_recording(31, steps=60, noise=0.2)[1])
    settings = FilterSettings(initialisation=initialisation, frames=5)
    assert_same(estimator(moved(recording), settings), estimator(recording, settings))


def test_dead_reckoning() -> None:
    _, recording = random_recording(33, steps=60)
    assert_same(dead_reckoning(moved(recording)), dead_reckoning(recording))
