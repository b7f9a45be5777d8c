"""Graph estimators with given associations, and the robust optimum with wrong ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Int
from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, fixed_lag, gtsam_batch, isam2, robust_batch
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from tests.reference.random_recordings import random_recording, recording_of

pytestmark = pytest.mark.slow

GraphEstimator = Callable[..., Estimate]
GTSAM = [pytest.param(each, marks=pytest.mark.gtsam) for each in (isam2, gtsam_batch, fixed_lag)]


def without_ids(seed: int, steps: int = 40) -> tuple[Truth, Recording, Int]:
    """Return a truth, the recording without ids, and the true ids."""
    truth, recording = random_recording(seed, steps=steps, landmarks=8)
    assert recording.landmark is not None
    return truth, replace(recording, landmark=None), recording.landmark


def assert_equal(actual: Estimate, expected: Estimate) -> None:
    for name in ("poses", "pose_covs", "landmarks"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name))


@pytest.mark.parametrize("optimum", [batch, causal, robust_batch])
@pytest.mark.parametrize("case", ["true", "merged", "partial"])
def test_given_ids_replace_those_of_the_recording(optimum: GraphEstimator, case: str) -> None:
    """The given ids are the true ones, merge two landmarks, or reject a third of the observations."""
    _, recording, ids = without_ids(1, steps=10)
    first, second = np.unique(ids)[:2]
    association = {
        "true": ids,
        "merged": np.where(ids == second, first, ids),
        "partial": np.where(np.arange(len(ids)) % 3 > 0, ids, -1),
    }[case]
    estimate = optimum(recording, association)
    assert_equal(estimate, optimum(replace(recording, landmark=association.clip(0)).only(association >= 0)))
    if case != "merged":
        np.testing.assert_array_equal(estimate.association, association)


@pytest.mark.parametrize("estimator", GTSAM)
def test_gtsams_solvers_accept_given_associations_or_those_of_a_filter(estimator: GraphEstimator) -> None:
    recording, name = recording_of("range-bearing", 1), estimator.__name__.replace("_", "-")
    assert recording.landmark is not None
    given = np.where(np.arange(len(recording.landmark)) % 4 == 0, -1, recording.landmark)
    np.testing.assert_array_equal(estimator(replace(recording, landmark=None), given).association, given)
    loaded = load_estimators([f"{name}@ekf"])[f"{name}@ekf"]
    expected = estimator(recording, ekf_slam(recording).association)
    np.testing.assert_array_equal(loaded(recording).poses, expected.poses)


@pytest.mark.parametrize("estimator", [isam2, gtsam_batch])
@pytest.mark.gtsam
def test_gtsams_solvers_ignore_a_landmark_with_a_single_bearing(estimator: GraphEstimator) -> None:
    recording = recording_of("bearing", 0)
    assert recording.landmark is not None
    ids = recording.landmark.copy()
    ids[len(ids) // 2] = 999
    found = estimator(replace(recording, landmark=ids))
    assert found.association is not None
    assert 999 not in found.landmark_ids
    assert found.association[len(ids) // 2] == -1
    assert set(found.association[found.association >= 0]) == {*found.landmark_ids.tolist()}


@pytest.mark.parametrize("estimator", [batch, causal, robust_batch, *GTSAM])
def test_without_associations_there_is_no_graph(estimator: GraphEstimator) -> None:
    with pytest.raises(ValueError, match=r"^landmark: the graph needs known association; [^\n]*$"):
        estimator(without_ids(0)[1])


def test_the_robust_optimum_rejects_wrong_associations_and_few_right_ones() -> None:
    truth, recording, ids = without_ids(2)
    assert truth.landmarks is not None
    assert truth.landmark_ids is not None
    rng = np.random.default_rng(0)
    changed = rng.choice(len(ids), 8, replace=False)
    wrong = ids.copy()
    for row in changed:  # the landmark farthest from the true one
        offsets = truth.landmarks - truth.landmarks[truth.landmark_ids == ids[row]]
        wrong[row] = truth.landmark_ids[np.argmax(np.hypot(*offsets.T))]
    robust, plain, clean = robust_batch(recording, wrong), batch(recording, wrong), batch(recording, ids)
    assert robust.association is not None
    rejected = robust.association == -1
    assert rejected[changed].all()
    assert rejected.sum() <= len(changed) + 2  # the expected number of rejected right ones is 0.16
    error, plain_error = (np.abs(each.poses - clean.poses)[:, :2].max() for each in (robust, plain))
    assert error < 0.1 * plain_error


def test_without_outliers_the_robust_optimum_is_the_optimum() -> None:
    _, recording, ids = without_ids(3)
    robust = robust_batch(recording, ids)
    np.testing.assert_array_equal(robust.association, ids)
    assert_equal(robust, batch(recording, ids))
