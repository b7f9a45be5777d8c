"""The surrogate's lower bound is valid and tight, wrong points are not certified, and `batch` has the same minimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamgauge import batch, load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.errors import UserError
from slamgauge.estimate import Certificate
from slamgauge.graph_baseline.problem.preparation import Problem, in_frame_of_start, prepare
from slamgauge.graph_baseline.solver import isotropic_surrogate as surrogates
from slamgauge.graph_baseline.solver.isotropic_surrogate import Complex, Surrogate, motion_variances
from slamgauge.graph_baseline.solver.multistart import chi_square_of
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, rotation


def recording_of(name: str) -> Recording:
    truth, recording = simulate(load_scenario(name), 0)
    assert truth.association is not None
    return recording.associated(truth.association)


def positions(seed: int, noise: float = 0.1, steps: int = 8) -> Problem:
    """Return isotropic positions of three landmarks at every step, and correlated motion noise of full rank."""
    rng = np.random.default_rng(seed)
    root = np.diag([0.05, 0.03, 0.04]) @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    odometry, landmarks = np.tile([0.5, 0.0, 0.4], (steps, 1)), rng.uniform(-4.0, 4.0, (3, 2))
    poses = [np.zeros(3)]
    for noisy in odometry + rng.normal(size=(steps, 3)) @ root.T:
        poses.append(compose(poses[-1], noisy))
    step, ids = np.repeat(np.arange(steps + 1), 3), np.tile(np.arange(3), steps + 1)
    at = np.array(poses)[step]
    seen = np.einsum("mji,mj->mi", rotation(at[:, 2]), landmarks[ids] - at[:, :2])
    recording = Recording(
        stamps=np.arange(steps + 1.0),
        prior_mean=np.zeros(3),
        prior_cov=np.zeros((3, 3)),
        odometry=odometry,
        odometry_cov=np.tile(root @ root.T, (steps, 1, 1)),
        sensor="position",
        observation_step=step,
        observation=seen + noise * rng.normal(size=seen.shape),
        observation_cov=np.tile(noise**2 * np.eye(2), (len(seen), 1, 1)),
        landmark=ids,
    )
    return prepare(recording)


def misread(problem: Problem, share: float) -> Problem:
    """Return the problem with a share of its ids replaced by random ids: its surrogate has many minima."""
    rng, ids = np.random.default_rng(0), problem.landmark.copy()
    rows = rng.random(len(ids)) < share
    ids[rows] = rng.choice(np.unique(ids), int(rows.sum()))
    return replace(problem, landmark=ids)


def solved(problem: Problem) -> tuple[Surrogate, Complex]:
    surrogate = surrogates.surrogate_of(problem)
    return surrogate, surrogates.minimum(surrogate, surrogates.spectral_headings(surrogate))


def written_out(problem: Problem, poses: Float, landmarks: Float) -> float:
    """Return the surrogate's cost as stated, for isotropic observations of positions."""
    moved, turned = motion_variances(problem.odometry_cov)
    step = between(poses[:-1], poses[1:])
    at = poses[problem.observation_step]
    seen = np.einsum("mji,mj->mi", rotation(at[:, 2]), landmarks[problem.slot] - at[:, :2])
    total = np.sum(np.square(step[:, :2] - problem.odometry[:, :2]).sum(axis=1) / moved)
    total += np.sum((2.0 - 2.0 * np.cos(step[:, 2] - problem.odometry[:, 2])) / turned)
    return 0.5 * float(total + np.sum(np.square(seen - problem.observation).T / problem.observation_cov[:, 0, 0]))


@pytest.mark.parametrize("seed", range(4))
def test_the_cost_is_the_stated_one_and_at_most_the_exact_cost(seed: int) -> None:
    problem = positions(seed)
    surrogate, rng = surrogates.surrogate_of(problem), np.random.default_rng(seed)
    for size in (0.01, 0.1, 1.0):
        x = np.exp(1j * size * rng.normal(size=surrogate.A.shape[1]))
        poses, landmarks = surrogates.path_and_map(problem, x)
        assert surrogate.cost(x) == pytest.approx(written_out(problem, poses, landmarks), rel=1e-9)
        assert surrogate.cost(x) <= 0.5 * chi_square_of(problem, poses, landmarks)[0] * (1.0 + 1e-9)


def test_derivatives_agree_with_differences() -> None:
    problem = positions(0)
    surrogate, rng = surrogates.surrogate_of(problem), np.random.default_rng(1)
    x = surrogates.with_positions(surrogate, np.exp(1j * rng.normal(size=surrogate.poses)))
    hessian, gradient = surrogates.derivatives(surrogate, x)
    steps = 1e-6 * np.eye(len(gradient))
    ahead, behind = ([surrogates.moved(surrogate, x, sign * each) for each in steps] for sign in (1.0, -1.0))
    slope = [(surrogate.cost(a) - surrogate.cost(b)) / 2e-6 for a, b in zip(ahead, behind, strict=True)]
    np.testing.assert_allclose(gradient, slope, atol=1e-6 * np.abs(slope).max())
    curvature = [
        (surrogates.derivatives(surrogate, a)[1] - surrogates.derivatives(surrogate, b)[1]) / 2e-6
        for a, b in zip(ahead, behind, strict=True)
    ]
    np.testing.assert_allclose(hessian.toarray(), curvature, atol=1e-6 * np.abs(curvature).max())


@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_the_bound_at_any_point_is_below_the_lowest_minimum_of_many_starts(seed: int, share: float) -> None:
    problem = misread(positions(seed, noise=0.3), share)
    surrogate, rng = surrogates.surrogate_of(problem), np.random.default_rng(seed)
    starts: Complex = np.exp(1j * rng.uniform(-np.pi, np.pi, (8, surrogate.poses)))
    found = [surrogates.minimum(surrogate, start) for start in starts]
    lowest = min(surrogate.cost(x) for x in found)
    for x in [*found, surrogates.with_positions(surrogate, starts[0]), solved(problem)[1]]:
        assert surrogates.lower_bound(surrogate, x) <= lowest


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_is_tight_at_the_minimum_and_only_there(seed: int) -> None:
    surrogate, x = solved(positions(seed))
    cost = surrogate.cost(x)
    assert cost * (1.0 - 1e-6) < surrogates.lower_bound(surrogate, x) <= cost
    turned = np.concatenate([x[:4], -x[4 : surrogate.poses]])
    for start in (turned, np.exp(1j * np.arange(surrogate.poses))):
        wrong = surrogates.with_positions(surrogate, start)
        assert surrogate.cost(wrong) > 2.0 * cost
        assert surrogates.lower_bound(surrogate, wrong) <= cost


def test_a_minimum_above_the_lowest_is_not_certified() -> None:
    """A long straight path is closed by landmarks; its headings may make a full turn, which is a minimum, too."""
    steps, rows = 16, np.array([0, 0, 16, 16])
    problem = replace(
        positions(0, steps=steps),
        odometry=np.zeros((steps, 3)),
        odometry_cov=np.tile(np.diag([1.0, 1.0, 0.01]), (steps, 1, 1)),
        observation_step=rows,
        observation=np.array([[3.0, 0.0], [0.0, 3.0], [3.0, 0.0], [0.0, 3.0]]),
        observation_cov=np.tile(0.01 * np.eye(2), (4, 1, 1)),
        landmark=np.array([0, 1, 0, 1]),
    )
    surrogate, best = solved(problem)
    assert surrogate.cost(best) < 1e-9
    x = surrogates.minimum(surrogate, np.exp(2j * np.pi * np.arange(steps + 1) / steps))
    hessian, gradient = surrogates.derivatives(surrogate, x)
    assert surrogate.cost(x) > 100.0
    assert np.abs(gradient).max() < 1e-6
    assert np.linalg.eigvalsh(hessian.toarray())[0] > 0.0
    assert surrogates.lower_bound(surrogate, x) == 0.0


def test_the_bound_is_valid_in_spite_of_rounding_errors() -> None:
    """Noise of 0.1 mm at 10 m leaves few digits of the cost; a factorisation succeeds there by chance."""
    problem = positions(0, noise=1e-4)
    surrogate, x = solved(replace(problem, odometry_cov=1e-8 * problem.odometry_cov))
    assert surrogates.lower_bound(surrogate, x) <= surrogate.cost(x)


@pytest.mark.parametrize("name", ["tp4-handout", "q1-short-dense", "freiburg-course"])
def test_a_shipped_scenario_is_certified_and_batch_has_the_same_minimum(name: str) -> None:
    found = batch(recording_of(name), certify=True).certificate
    assert found is not None
    assert found.is_tight and found.is_same_minimum and not found.bounds_optimum


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_is_below_the_exact_minimum_of_positions(seed: int) -> None:
    found = batch(positions(seed), certify=True).certificate
    assert found is not None
    assert found.is_tight and found.is_same_minimum and found.bounds_optimum
    assert 0.5 * found.optimum_cost < found.lower_bound < found.optimum_cost


def test_the_start_does_not_depend_on_the_frame() -> None:
    recording = recording_of("tp4-handout")
    moved = prepare(replace(recording, prior_mean=np.array([3.0, -2.0, 0.5])))
    poses, landmarks = surrogates.surrogate_start(moved)
    local_poses, local_landmarks = surrogates.surrogate_start(prepare(in_frame_of_start(moved)))
    np.testing.assert_allclose(poses, compose(moved.prior_mean, local_poses), atol=1e-9)
    turned = np.column_stack([local_landmarks, np.zeros(len(landmarks))])
    np.testing.assert_allclose(landmarks, compose(moved.prior_mean, turned)[:, :2], atol=1e-9)


def test_bearing_only_and_unobserved_recordings_are_refused() -> None:
    recording = recording_of("freiburg-course")
    with pytest.raises(UserError, match="certify: nothing is observed"):
        batch(recording.associated(np.full(len(recording.observation), -1)), certify=True)
    with pytest.raises(UserError, match="certify: does not apply to bearing-only"):
        batch(recording_of("q4-ring"), certify=True)


def test_a_certificate_with_a_gap_or_another_minimum_says_so() -> None:
    found = Certificate(10.0, 9.0, 30.0, 31.0, bounds_optimum=False)
    assert found.relative_gap == pytest.approx(0.1)
    assert not found.is_tight
    assert not found.is_same_minimum
