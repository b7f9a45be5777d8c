"""Scores by hand-computed cases, laws, and the JSON form."""

import json
import math
from collections.abc import Callable
from dataclasses import astuple, fields, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge.arrays import Float
from slamgauge.compare.scoring.catalogue import BY_KEY, LoopClosure
from slamgauge.compare.scoring.run_arrays import closure_steps
from slamgauge.compare.scoring.scores import Score, evaluate
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import compose, pose_rotation, rotation
from slamgauge.truth import Truth
from tests.reference.given import given as there

from .builders import path, straight

METRICS_JSON = {"kind", *(key for key, each in BY_KEY.items() if each.measure is not None)}
true: Any = Truth  # Any: lists instead of arrays
filtered: Any = partial(Estimate, "filtered")
smoothed: Any = partial(Estimate, "smoothed")
angles = st.floats(-math.pi, math.pi)
places = st.floats(-5e6, 5e6)


def constant_covs(recording: Recording, *variances: float) -> Float:
    return np.tile(np.diag(variances), (recording.steps + 1, 1, 1))


# --- hand-computed cases -----------------------------------------------------------------------


def test_path_errors_by_hand() -> None:
    recording = straight(2)
    poses = path(recording, [[0, 0, 0], [3, 4, 0.1], [0, 0, -0.2]])
    score = evaluate(true(path(recording)), recording, filtered(poses))
    assert score["ate_m"] == pytest.approx(5 / math.sqrt(3))
    assert score["heading_rmse_rad"] == pytest.approx(math.sqrt(0.05 / 3))
    assert score["final_position_error_m"] == 0
    # steps in the body frame: (4, 4) for (1, 0), then R(0.1)' (-2, -4) for (1, 0)
    second = rotation(0.1).T @ [-2, -4] - [1, 0]
    assert score["rpe_m"] == pytest.approx(math.sqrt((25 + second @ second) / 2))
    turned = evaluate(true(path(recording)), recording, smoothed(path(recording, [0, 0, 2 * math.pi])))
    assert [turned[key] for key in ("ate_m", "heading_rmse_rad", "rpe_m")] == pytest.approx([0, 0, 0])


def test_a_gap_in_the_truth_is_left_out() -> None:
    recording = straight(3)
    poses = path(recording)
    poses[1] = poses[3] = np.nan
    estimate = filtered(path(recording, [1, 0, 0]), constant_covs(recording, 1, 1, 1))
    score = evaluate(true(poses), recording, estimate)
    assert score.nees == pytest.approx([1, np.nan, 1, np.nan], nan_ok=True)
    keys = ("ate_m", "nees_pose", "final_position_error_m", "rpe_m")
    assert [score[key] for key in keys] == [1, 1, None, None]  # no two consecutive true poses


def test_figures_against_the_optimum_by_hand() -> None:
    recording = straight(3)
    truth = true(path(recording))
    optimum = filtered(path(recording, [0, 0.1, 0]), constant_covs(recording, 1, 0.01, 0.04))
    estimate = filtered(path(recording, [0, -0.3, 0.2]), constant_covs(recording, 0.25, 0.01, 0.16))
    score = evaluate(truth, recording, estimate, optimum)
    assert score["ratio_to_optimum"] == pytest.approx(3)
    assert score["mahalanobis_to_optimum"] == pytest.approx(0.4**2 / 0.01 + 0.2**2 / 0.04)
    for size, ratio in ((1e-12, None), (1e-8, pytest.approx(3.0))):  # nothing is divided by rounding errors
        paths = [filtered(path(recording, [0, factor * size, 0])) for factor in (3, 1)]
        assert evaluate(truth, recording, *paths)["ratio_to_optimum"] == ratio


def test_a_fixed_start_is_skipped_in_comparisons_of_covariances() -> None:
    recording = straight(2)
    covs = constant_covs(recording, 1, 1, 1)
    covs[0] = 0
    optimum = filtered(path(recording, [0, 0, 1]), 4 * covs)
    score = evaluate(true(path(recording, [1, 1, 1])), recording, filtered(path(recording), covs), optimum)
    assert score.nees == pytest.approx([np.nan, 3, 3], nan_ok=True)
    assert (score["nees_pose"], score["mahalanobis_to_optimum"]) == (pytest.approx(3), pytest.approx(0.25))


def test_nis_and_seconds_are_summed() -> None:
    recording = straight(2)
    estimate = filtered(path(recording), nis=[0, 3, 6], nis_dof=[0, 2, 4], seconds=[1, 2, 6])
    score = evaluate(None, recording, estimate)
    assert (score["nis_total"], score["nis_dof_total"], score["nis_per_dof"]) == (9, 6, 1.5)
    assert score["seconds_total"] == 9


def test_landmarks_are_compared_by_id() -> None:
    recording = straight(2, [(0, 3), (1, 7)])
    truth = true(path(recording), [7, 3, 9], [[7, 0], [3, 0], [9, 0]], [3, 7])
    covs = np.tile(np.diag([0.25, 1.0]), (2, 1, 1))
    estimate = filtered(path(recording), None, [3, 7], [[3, 1], [7.5, 0]], covs, [3, 7])
    score = evaluate(truth, recording, estimate)
    assert score["landmark_rmse_m"] == pytest.approx(math.sqrt((1 + 0.25) / 2))
    assert score["landmark_nees_per_dof"] == pytest.approx((1 + 1) / 2 / 2)
    deviation = pytest.approx(math.sqrt(1.25))
    assert [*score["map_halves"].values()] == [1, 0.5, deviation, deviation]
    assert associations(score) == (2, 2, 0, 0)


# --- association -------------------------------------------------------------------------------


def associations(score: Score) -> tuple[int | None, ...]:
    keys = ("landmarks_mapped", "landmarks_true", "landmarks_missed", "wrong_associations")
    return tuple(score[key] for key in keys)


def test_wrong_associations_with_ids_are_those_that_differ() -> None:
    recording = straight(4, [(0, 5), (1, 6), (2, 5), (3, 6), (4, 10)])  # the last one is clutter
    truth = true(landmark_ids=[5, 6], landmarks=np.zeros((2, 2)), association=[5, 6, 5, 6, -1])
    estimate = filtered(path(recording), None, [5, 6, 10], np.zeros((3, 2)), association=[6, 6, -1, 5, 10])
    assert associations(evaluate(truth, recording, estimate)) == (3, 2, 0, 2)
    assert associations(evaluate(true(), recording, estimate)) == (3, None, None, None)


@pytest.mark.parametrize(
    ("true_ids", "tracks", "given", "counts", "error"),
    [
        # track 0 is landmark 6 (with one observation of 5), tracks 1 and 2 are landmark 5 and a duplicate of 6
        ([5, 6, 5, 6, 6], {0: [6, 1], 1: [5, 1], 2: [6, 1]}, [1, 0, 0, 2, -1], (3, 2, 0, 1), 1.0),
        ([5, 6, 6, 6, 7], {3: [6, 0.5]}, [3, 3, 3, 3, -1], (1, 3, 2, 1), 0.5),  # most observations count
        ([5, 6, 6, 6, 7], {5: [5, 0]}, None, (1, 3, None, None), None),
        # clutter is rejected, starts a false track, or is assigned to a wrong one
        ([5, 6, -1, 5, 6], {0: [5, 1], 1: [6, 1]}, [0, 1, -1, 0, 1], (2, 2, 0, 0), 1.0),
        ([5, 6, -1, 5, 6], {0: [5, 1], 1: [6, 1], 2: [9, 9]}, [0, 1, 2, 0, 1], (3, 2, 0, 0), 1.0),
        ([5, 6, -1, 5, 6], {0: [5, 1], 1: [6, 1]}, [0, 1, 1, 0, 1], (2, 2, 0, 1), 1.0),
    ],
)
def test_tracks_of_unknown_association_are_matched_one_to_one(
    true_ids: list[int], tracks: dict[int, Any], given: Any, counts: tuple[int | None, ...], error: float | None
) -> None:
    recording = replace(straight(4, [(step, 5) for step in range(5)]), landmark=None)
    truth = true(path(recording), [5, 6, 7], [[5, 0], [6, 0], [7, 0]], true_ids)
    estimate = filtered(path(recording), None, [*tracks], [*tracks.values()], association=given)
    score = evaluate(truth, recording, estimate)
    assert associations(score) == counts
    assert score["landmark_rmse_m"] == (None if error is None else pytest.approx(error))


def test_without_observations_there_are_no_rays() -> None:
    none = {"observation": np.zeros((0, 1)), "observation_cov": np.zeros((0, 1, 1))}
    recording = replace(straight(1), sensor="bearing", **none)
    truth = true(path(recording), [7], [[100, 0]], np.zeros(0, int))
    rays = there(evaluate(truth, recording, ekf_slam(recording))["rays"])
    assert {*rays.values()} == {0.0}


# --- loop closures -----------------------------------------------------------------------------


def test_a_loop_closes_after_ten_seconds_without_observation() -> None:
    seen = [(0, 1), (0, 2), (50, 2), (99, 1), (149, 2), (150, 2), (199, 1), (199, 2)]
    recording = straight(200, seen, dt=0.1)
    # 1 is not observed for 9.9 s, then for 10 s (rounding included); 2 for 5, 9.9, 0.1 and 4.9 s
    assert there(closure_steps(None, recording)).tolist() == [199]


def test_loop_closure_entries_by_hand() -> None:
    recording = straight(4, [(0, 1), (0, 2), (2, 1), (2, 2), (4, 2)], dt=10.0)
    poses = path(recording, [[0, 0, 0], [3, 4, 0], [0, 1, 0], [0, 2, 0], [0, 0, 0]])
    covs = constant_covs(recording, 9, 16, 1)
    covs[4] = np.eye(3)
    closures = evaluate(true(path(recording)), recording, filtered(poses, covs))["loop_closure"]
    assert [*map(astuple, closures)] == [(2, 5, 1, 5, 5), (4, 2, 0, 5, pytest.approx(math.sqrt(2)))]


def test_loop_closures_need_ids_and_their_errors_the_truth() -> None:
    named = straight(2, [(0, 1), (2, 1)], dt=10.0)
    nameless = replace(named, landmark=None)
    closure = (LoopClosure(2, None, None, None, None),)
    for truth, recording, found in (
        (None, named, closure),
        (None, nameless, None),
        (true(association=[1, 1]), nameless, closure),
        (true(association=[-1, -1]), nameless, ()),  # clutter
    ):
        assert evaluate(truth, recording, filtered(path(named)))["loop_closure"] == found


# --- laws --------------------------------------------------------------------------------------


@given(places, places, angles, st.integers(0, 2**32 - 1))
def test_a_rigid_motion_of_the_world_changes_no_figure(x: float, y: float, turn: float, seed: int) -> None:
    """Robots log UTM positions: neighbouring doubles are 1e-9 m apart there."""
    rng = np.random.default_rng(seed)
    recording = straight(5, [(1, 7), (4, 7)])
    poses, errors, A = rng.normal(size=(6, 3)), rng.normal(size=(2, 6, 3)) * [1, 1, 0.3], rng.normal(size=(6, 3, 3))
    covs, T, place = A @ A.swapaxes(1, 2) + 0.1 * np.eye(3), pose_rotation(turn), np.array([x, y, turn])

    def scored(moved: Callable[[Float], Float], R: Float) -> Score:
        landmark, best = moved(np.array([[2.0, 3.0, 0.0], [2.5, 3.0, 0.0]])), R @ (2 * covs) @ R.T
        truth = true(moved(poses + errors[0]), [7], landmark[:1, :2], [7, 7])
        mapped = {"landmark_ids": [7], "landmarks": landmark[1:, :2], "association": [7, 7]}
        return evaluate(
            truth, recording, filtered(moved(poses), R @ covs @ R.T, **mapped), filtered(moved(poses + errors[1]), best)
        )

    before, after = scored(lambda each: each, np.eye(3)), scored(lambda each: compose(place, each), T)
    assert after.nees == pytest.approx(before.nees, rel=1e-6)
    known = {key: value for key, value in before.items() if isinstance(value, float)}
    assert {key: after[key] for key in known} == pytest.approx(known, rel=1e-6, abs=1e-8)
    assert {*known} >= {"ate_m", "rpe_m", "nees_position", "ratio_to_optimum", "landmark_rmse_m"}


# --- the JSON form and the errors --------------------------------------------------------------


def test_json_has_exactly_the_keys_and_no_nan() -> None:
    recording = straight(2, [(0, 1), (2, 1)], dt=10.0)
    poses = path(recording)
    covs = constant_covs(recording, 1, 1, 1)
    full = filtered(poses, covs, [1], [[1, 0]], [np.eye(2)], [1, 1], [0, 0, 2], [0, 0, 2], [1, 1, 1])
    truth = true(poses, [1], [[1, 0]], [1, 1])
    hindsight = replace(full, kind="smoothed")
    scores = [
        evaluate(truth, recording, full, full),
        evaluate(None, recording, filtered(poses)),
        evaluate(true(np.full((3, 3), np.nan)), recording, smoothed(poses, 0 * covs), hindsight),
    ]
    for score in scores:
        entry = score.to_json()
        assert set(entry) == METRICS_JSON
        assert json.loads(json.dumps(entry, allow_nan=False)) == entry
    assert {*scores[0].to_json()["loop_closure"][0]} == {each.name for each in fields(LoopClosure)}
    given_anyway = {"kind", "landmarks_mapped", "loop_closure", "nis_total", "nis_dof_total"}
    assert {key for key, value in scores[1].to_json().items() if value is not None} == given_anyway


UNFIT = filtered(np.zeros((3, 3)), None, [1], [[1, 0]], association=[1, 1])
SHORT, FIT = filtered(np.zeros((2, 3))), filtered(np.zeros((3, 3)))


@pytest.mark.parametrize(
    ("truth", "estimates", "message"),
    [
        (None, [SHORT], "estimate.poses: 2 rows, but the recording needs 3; give its own$"),
        (true(np.zeros((2, 3))), [FIT], "truth.poses: 2 rows"),
        (None, [FIT, SHORT], "optimum.poses: 2 rows"),
        (None, [UNFIT], "estimate.association: 2 rows, but the recording needs 1"),
        (None, [FIT, replace(FIT, kind="smoothed")], "optimum.kind: 'smoothed' instead of 'filtered'; compare"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(truth: Truth | None, estimates: list[Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        evaluate(truth, straight(2, [(0, 1)]), *estimates)
