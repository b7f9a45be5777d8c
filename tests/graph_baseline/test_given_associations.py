"""The graph under associations that somebody else has made, and with outliers among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge.arrays import Int
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal, robust_batch
from slamgauge.recording import Recording
from slamgauge.truth import Truth
from tests.reference.random_recordings import random_recording

OPTIMA = pytest.mark.parametrize("optimum", [batch, causal, robust_batch])


def blind(seed: int, steps: int = 40) -> tuple[Truth, Recording, Int]:
    """A truth, the recording without ids, and the true ids."""
    truth, recording = random_recording(seed, steps=steps, landmarks=8)
    assert recording.landmark is not None
    return truth, replace(recording, landmark=None), recording.landmark


def same(one: Estimate, other: Estimate) -> None:
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.pose_covs, other.pose_covs)
    np.testing.assert_array_equal(one.landmarks, other.landmarks)


@OPTIMA
def test_the_true_associations_give_what_known_association_gives(optimum):  # pyright: ignore[reportMissingParameterType]
    _, recording, ids = blind(0)
    given = optimum(recording, ids)
    same(given, optimum(replace(recording, landmark=ids)))
    np.testing.assert_array_equal(given.association, ids)


@OPTIMA
def test_given_ids_come_before_the_recordings_own(optimum):  # pyright: ignore[reportMissingParameterType]
    """The given ones take two landmarks for one, over so few steps that a minimum is found at once."""
    _, recording, ids = blind(0, steps=10)
    first, second = np.unique(ids)[:2]
    merged = np.where(ids == second, first, ids)
    same(optimum(replace(recording, landmark=ids), merged), optimum(replace(recording, landmark=merged)))


@pytest.mark.parametrize("optimum", [batch, causal])
def test_rejected_observations_are_left_out(optimum):  # pyright: ignore[reportMissingParameterType]
    _, recording, ids = blind(1)
    kept = np.arange(len(ids)) % 3 > 0
    association = np.where(kept, ids, -1)
    estimate = optimum(recording, association)
    same(estimate, optimum(replace(recording, landmark=ids).only(kept)))
    np.testing.assert_array_equal(estimate.association, association)


@OPTIMA
def test_without_associations_there_is_no_graph(optimum):  # pyright: ignore[reportMissingParameterType]
    with pytest.raises(ValueError, match="known association"):
        optimum(blind(0)[1])


def test_the_robust_optimum_leaves_out_planted_outliers_and_nearly_nothing_else():
    truth, recording, ids = blind(2)
    assert truth.landmarks is not None
    assert truth.landmark_ids is not None
    rng = np.random.default_rng(0)
    planted = rng.choice(len(ids), 8, replace=False)
    wrong = ids.copy()
    for row in planted:  # a landmark that is far from the true one
        offsets = truth.landmarks - truth.landmarks[truth.landmark_ids == ids[row]]
        wrong[row] = truth.landmark_ids[np.argmax(np.hypot(*offsets.T))]
    robust, plain, clean = robust_batch(recording, wrong), batch(recording, wrong), batch(recording, ids)
    assert robust.association is not None
    rejected = robust.association == -1
    assert rejected[planted].all()
    assert rejected.sum() <= len(planted) + 2  # of some 160 true ones, one in a thousand is expected
    error = {name: np.abs(each.poses - clean.poses)[:, :2].max() for name, each in (("r", robust), ("p", plain))}
    assert error["r"] < 0.1 * error["p"]


def test_where_nothing_is_wrong_the_robust_optimum_is_the_optimum():
    _, recording, ids = blind(3)
    robust = robust_batch(recording, ids)
    np.testing.assert_array_equal(robust.association, ids)
    same(robust, batch(recording, ids))
