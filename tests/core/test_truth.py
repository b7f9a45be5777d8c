"""Missing fields and gaps of a truth."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np

from slamgauge.truth import Truth
from tests.reference.example_records import truth


def test_every_field_of_a_truth_may_be_missing() -> None:
    nothing = Truth()
    assert [getattr(nothing, field.name) for field in fields(Truth)] == [None] * 5
    assert truth(landmark_ids=None, landmarks=None, association=[7, 7]).association is not None
    no_landmarks = truth(landmark_ids=[], landmarks=np.zeros((0, 2)), association=[]).landmarks
    assert no_landmarks is not None
    assert no_landmarks.shape == (0, 2)


def test_a_truth_may_have_gaps() -> None:
    with_gap = truth(poses=[[0, 0, 4.0], [math.nan] * 3, [1, 1, -4.0]]).poses
    assert with_gap is not None
    assert np.isnan(with_gap[1]).all()
    np.testing.assert_allclose(with_gap[[0, 2], 2], [4.0 - 2 * math.pi, 2 * math.pi - 4.0])


def test_a_truth_may_have_positions_without_headings():
    poses = np.array([[0.0, 0.0, np.nan], [1.0, 0.0, np.nan], [np.nan, np.nan, np.nan]])
    np.testing.assert_array_equal(Truth(poses=poses).poses, poses)
