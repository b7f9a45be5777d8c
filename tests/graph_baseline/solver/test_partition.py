"""The partition into pieces does not change step and covariances of the linear problem.

Differences are in standard deviations. Problems are small and seeds are fixed.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from slamgauge.errors import UserError
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.problem.linearisation import LinearModel
from slamgauge.graph_baseline.problem.objective import Objective
from slamgauge.graph_baseline.problem.preparation import prepare
from slamgauge.graph_baseline.solver import levenberg_marquardt, memory_estimate, partition
from slamgauge.graph_baseline.solver.elimination import Scans
from slamgauge.graph_baseline.solver.levenberg_marquardt import scans_of
from slamgauge.graph_baseline.solver.multifrontal import covariance_roots, factorise, minimise, nested_dissection
from slamgauge.graph_baseline.solver.partition import Plan, plan, plan_of
from slamgauge.graph_baseline.solver.smoother import NOT_DAMPED, Damping, Solution, damped_step, solve
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation
from tests.reference.random_recordings import random_recording
from tests.reference.small_problems import assert_same_covariances

pytestmark = pytest.mark.slow

TOLERANCE = 1e-9  # in standard deviations, and in variances


def lanes(*, sensor: str = "range-bearing", slip: bool = True, lanes: int = 3, length: int = 15) -> Recording:
    """Simulate a drive in lanes: a scan observes landmarks within 2.5 m, so that neighbouring lanes share landmarks."""
    turns = np.zeros((lanes * length, 3))
    turns[:, 0] = 1.0
    for lane in range(1, lanes):
        turns[lane * length - 1 : lane * length + 1, 2] = np.pi / 2 if lane % 2 else -np.pi / 2
    turns[::length, 0] = 3.0
    path = chain(np.zeros(3), turns)
    rng = np.random.default_rng(0)
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    places = rng.uniform(low - 1.0, high + 1.0, (2 * len(path), 2))
    offset = places - path[:, None, :2]
    step, landmark = np.nonzero(np.abs(np.hypot(offset[..., 0], offset[..., 1]) - 1.5) < 1.0)
    delta = np.einsum("nji,nj->ni", rotation(path[step, 2]), offset[step, landmark])
    polar = np.column_stack([np.hypot(*delta.T), np.arctan2(delta[:, 1], delta[:, 0])])
    exact = {"range-bearing": polar, "position": delta, "bearing": polar[:, 1:]}[sensor]
    sigma = {"range-bearing": [0.1, 0.02], "position": [0.1, 0.1], "bearing": [0.02]}[sensor]
    return Recording(
        stamps=np.arange(len(path), dtype=np.float64),
        prior_mean=np.zeros(3),
        prior_cov=np.diag([0.01, 0.01, 1e-4]),
        odometry=turns + rng.normal(size=turns.shape) * [0.02, 0.01 * slip, 0.005],
        odometry_cov=np.tile(np.diag([0.02, 0.01 * slip, 0.005]) ** 2, (len(turns), 1, 1)),
        sensor=sensor,  # pyrefly: ignore[bad-argument-type]
        observation_step=step,
        observation=exact + rng.normal(size=exact.shape) * sigma,
        observation_cov=np.tile(np.diag(sigma) ** 2, (len(step), 1, 1)),
        landmark=landmark,
    )


class Linear(NamedTuple):
    """A linear problem."""

    scans: Scans
    model: LinearModel
    landmarks: int


def linear_problem(recording: Recording) -> Linear:
    """Return the problem linearised at dead reckoning with random landmarks near it."""
    problem = prepare(recording)
    objective, path = Objective(problem), problem.dead_reckoning
    first = problem.observation_step[problem.first_row]
    places = path[first, :2] + np.random.default_rng(1).uniform(1.0, 2.0, (len(first), 2))
    return Linear(scans_of(objective), objective.at(path, places).model, len(first))


def one_piece(scans: Scans, model: LinearModel, landmarks: int) -> Plan:
    """Return the plan of a path without cuts."""
    return plan_of(scans, model, landmarks, np.zeros(0, dtype=np.int64))


def solution(linear: Linear, planned: Plan, damping: Damping = NOT_DAMPED) -> Solution:
    """Return undamped covariances and the damped step."""
    dx, dm = damped_step(linear.model, linear.scans, planned, damping)
    return solve(linear.model, linear.scans, planned)._replace(dx=dx, dm=dm)


def assert_pieces_change_nothing(recording: Recording, least: int, damping: Damping = NOT_DAMPED) -> None:
    """Compare the solution in more than `least` pieces with that of a single piece."""
    linear = linear_problem(recording)
    planned = plan(*linear)
    assert len(planned.pieces) > least
    assert_same(solution(linear, planned, damping), solution(linear, one_piece(*linear), damping))


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut small maps too, into pieces of few landmarks."""
    monkeypatch.setattr(partition, "LANDMARKS", 5)
    monkeypatch.setattr(partition, "OVERHEAD", 0.0)
    monkeypatch.setattr("slamgauge.graph_baseline.solver.multifrontal.ASSEMBLY", 0.0)


def assert_same(found: Solution, expected: Solution) -> None:
    sigmas = [np.sqrt(np.diagonal(covs, axis1=1, axis2=2)) for covs in expected[2:]]
    for mine, other, sigma in zip(found[:2], expected[:2], sigmas, strict=True):
        scale = np.where(sigma > 0.0, sigma, 1.0)
        np.testing.assert_allclose((mine - other) / scale / max(1.0, np.abs(other / scale).max()), 0.0, atol=TOLERANCE)
    for mine, other, sigma in zip(found[2:], expected[2:], sigmas, strict=True):
        scale = np.where(sigma > 0.0, sigma, 1.0)
        np.testing.assert_allclose((mine - other) / scale[:, :, None] / scale[:, None], 0.0, atol=TOLERANCE)


# --- same solution -------------------------------------------------------------------------------


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("sensor", ["range-bearing", "position", "bearing"])
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
@pytest.mark.parametrize("damping", [NOT_DAMPED, Damping(np.array([1.0, 1.0, 9.0]), 0.5, 0.1)], ids=["free", "damped"])
def test_the_solution_of_a_field_in_pieces_is_that_of_a_single_piece(sensor: str, slip: bool, damping: Damping) -> None:
    recording = lanes(sensor=sensor, slip=slip)
    if sensor == "bearing":  # a single bearing does not determine a landmark
        assert recording.landmark is not None
        recording = recording.only(np.bincount(recording.landmark)[recording.landmark] > 2)
    assert_pieces_change_nothing(recording, 10, damping)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("slip", [True, False], ids=["slip", "no-slip"])
def test_the_solution_of_a_random_recording_in_pieces_is_that_of_a_single_piece(
    seed: int, slip: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The covariances have correlations, and landmarks are observed at random times."""
    recording = random_recording(seed, sensor="position", steps=120, landmarks=40, slip=slip)[1]
    recording = recording.only(np.random.default_rng(seed).random(len(recording.observation)) < 0.1)

    def prefer_pieces(planned: Plan) -> int:
        return -len(planned.pieces)

    monkeypatch.setattr(partition, "work", prefer_pieces)
    assert_pieces_change_nothing(recording, 5)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("fixed", [True, False], ids=["fixed", "prior"])
def test_poses_without_observations_are_smoothed_across_cuts(fixed: bool) -> None:
    recording = lanes(slip=False)
    recording = recording.only(recording.observation_step % 3 == 1)
    if fixed:
        recording = replace(recording, prior_cov=np.zeros((3, 3)))
    assert_pieces_change_nothing(recording, 5)


@pytest.mark.usefixtures("small_pieces")
def test_a_chain_is_not_cut_after_motions_with_little_noise() -> None:
    recording = lanes()
    still = np.zeros_like(recording.odometry_cov)
    for covs, cut in ((still, False), (1e-12 * recording.odometry_cov, False), (recording.odometry_cov, True)):
        some = replace(recording, odometry_cov=np.where(np.arange(len(covs))[:, None, None] < 22, covs, still))
        linear = linear_problem(some)
        at = partition.cuts(linear.scans, linear.model)
        assert (at < 22).any() == cut
        assert not (at >= 24).any()
        assert_pieces_change_nothing(some, 0)


@pytest.mark.usefixtures("small_pieces")
def test_an_undetermined_landmark_raises_in_pieces_too() -> None:
    linear = linear_problem(lanes(sensor="bearing"))
    planned = plan(*linear)
    assert len(planned.pieces) > 10
    with pytest.raises(np.linalg.LinAlgError):
        solve(linear.model, linear.scans, planned)


def test_a_large_map_is_cut_but_a_small_or_dense_one_is_not() -> None:
    for recording, cut in ((lanes(lanes=8, length=40), True), (lanes(lanes=2, length=30), False)):
        assert (len(plan(*linear_problem(recording)).pieces) > 1) == cut
    dense = random_recording(0, steps=60, landmarks=150)[1]
    assert len(plan(*linear_problem(dense)).pieces) == 1


# --- elimination tree ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_covariance_roots_belong_to_blocks_of_the_inverse(seed: int) -> None:
    """The pieces have random unknowns, each with information of full rank."""
    rng = np.random.default_rng(seed)
    columns = [np.sort(rng.choice(40, rng.integers(3, 12), replace=False)) for _ in range(13)]
    columns[0] = np.union1d(columns[0], np.setdiff1d(np.arange(40), np.concatenate(columns)))
    information_of = [np.zeros((0, 0))] * len(columns)
    information = np.zeros((41, 41))
    for number, unknowns in enumerate(columns):
        rows = rng.normal(size=(len(unknowns) + 2, len(unknowns) + 1))
        information_of[number] = rows.T @ rows
        at = np.append(unknowns, 40)
        information[np.ix_(at, at)] += information_of[number]
    damping_of = rng.uniform(0.0, 1.0, 40)
    information[np.arange(40), np.arange(40)] += damping_of
    inverse = np.linalg.inv(information[:40, :40])
    front = nested_dissection(columns, rng.normal(size=(13, 2)))
    factor, left = factorise(front, information_of.__getitem__, damping_of, np.zeros(40))
    unknowns = np.append(np.zeros(40), 1.0)
    minimise(factor, unknowns)
    np.testing.assert_allclose(unknowns[:40], -inverse @ information[:40, 40], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(left[0, 0], information[40] @ unknowns, rtol=1e-10)
    met = set[int]()
    for number, place, root in covariance_roots(factor, np.zeros((0, 0))):
        met.add(number)
        np.testing.assert_array_equal(np.tril(root, -1), 0.0)
        expected = inverse[np.ix_(columns[number], columns[number])]
        np.testing.assert_allclose((root @ root.T)[np.ix_(place, place)], expected, rtol=1e-9, atol=1e-12)
    assert met == set(range(13))


# --- memory --------------------------------------------------------------------------------------


def peak_of_solving(linear: Linear, planned: Plan) -> float:
    """Return the peak memory of `solve` in bytes."""
    tracemalloc.start()
    solve(linear.model, linear.scans, planned)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(peak)


def test_memory_grows_linearly_with_the_map_and_its_estimate_is_an_upper_bound() -> None:
    """The estimate is at most ten times too large. Memory of a single piece would grow with the square of the map."""
    peaks: list[float] = []
    for size in (1, 2, 4, 8):
        linear = linear_problem(lanes(lanes=size, length=20))
        planned = plan(*linear)
        estimate, peak = memory_estimate.bytes_of(planned), peak_of_solving(linear, planned)
        if size > 1:  # the first also compiles kernels
            assert 0.1 * estimate < peak < estimate
            peaks.append(peak)
    assert peaks[0] < peaks[1] < peaks[2] < 3.0 * peaks[1]


def test_a_map_that_fits_into_memory_only_in_pieces_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = lanes(lanes=8, length=40)
    monkeypatch.setattr(memory_estimate, "free_memory", lambda: 3e7)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 3e7)
    for name in ("batch", "robust-batch", "gtsam-batch", "isam2"):
        memory_estimate.require_memory_for(prepare(recording), name)
    with pytest.raises(UserError, match=r"^causal of \d+ landmarks in \d+ poses needs 0\.1 GB of memory"):
        memory_estimate.require_memory_for(prepare(recording), "causal")


# --- the optimum ---------------------------------------------------------------------------------


@pytest.mark.usefixtures("small_pieces")
def test_the_optimum_in_pieces_is_that_of_a_single_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = lanes(slip=False)
    assert len(plan(*linear_problem(recording)).pieces) > 5
    found = batch(recording)
    monkeypatch.setattr(levenberg_marquardt, "plan", one_piece)
    expected = batch(recording)
    assert found.pose_covs is not None and expected.pose_covs is not None
    sigma = np.sqrt(np.diagonal(expected.pose_covs, axis1=1, axis2=2))
    np.testing.assert_allclose((found.poses - expected.poses) / sigma, 0.0, atol=1e-7)
    assert_same_covariances(found.pose_covs, expected.pose_covs, 1e-7)
