"""The walk of `benchmarks/posterior_mean.py`: its density is the exact one, its proposals are the linear model's."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from posterior_mean import Posterior, Step, sampled
from random_recordings import random_recording
from referees.least_squares import Model
from scipy.stats import chi2

from slamgauge.arrays import Float
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch
from slamgauge.graph_baseline.problem.linearisation import linearise
from slamgauge.recording import Recording

DRAWS = 2000
FALSE_ALARM = 1e-4


class Problem(NamedTuple):
    recording: Recording
    optimum: Estimate
    posterior: Posterior
    model: Model


@pytest.fixture(params=["range-bearing", "position"])
def problem(request: pytest.FixtureRequest) -> Problem:
    recording = random_recording(4, sensor=request.param, steps=4, landmarks=3, noise=3.0)[1]
    optimum = batch(recording)
    return Problem(recording, optimum, Posterior(recording, optimum.poses, optimum.landmarks), Model(recording))


def unknowns(problem: Problem, step: Step) -> Float:
    """Noise and landmarks after a step."""
    poses, landmarks = problem.posterior.moved(step)
    return problem.model.unknowns(problem.model.relative(poses), problem.model.relative(landmarks))


def test_what_the_linear_model_says_and_what_the_posterior_adds_are_the_exact_cost(problem: Problem):
    rng = np.random.default_rng(1)
    lowest = problem.model.cost(unknowns(problem, zero(problem)))
    added = []
    for _ in range(20):
        step = problem.posterior.draw(rng)
        exact = problem.model.cost(unknowns(problem, step)) - lowest
        added.append(problem.posterior.at(step)[1])
        assert linear_cost(problem, step) + added[-1] == pytest.approx(exact, rel=1e-6, abs=1e-6)
    assert max(np.abs(added)) > 0.01, "the problem is all but linear: nothing is tried"


def zero(problem: Problem) -> Step:
    return np.zeros_like(problem.optimum.poses), np.zeros_like(problem.optimum.landmarks)


def linear_cost(problem: Problem, step: Step) -> float:
    """Half the squared length of a step, in standard deviations of what was measured."""
    assert problem.recording.landmark is not None
    slot = np.unique(problem.recording.landmark, return_inverse=True)[1]
    model = linearise(problem.recording, slot, problem.optimum.poses, problem.optimum.landmarks)
    dx, dm = step
    moved = np.concatenate([dx[:1], dx[1:] - np.einsum("nij,nj->ni", model.F, dx[:-1])])
    covs = np.concatenate([model.start_cov[None], model.W])
    seen = np.einsum("mdi,mi->md", model.Hx, dx[model.step]) + np.einsum("mdi,mi->md", model.Hm, dm[model.slot])
    return 0.5 * float(np.einsum("ni,nij,nj->", moved, np.linalg.inv(covs), moved) + np.square(seen).sum())


def test_steps_keep_volumes(problem: Problem):
    """Of noise and landmarks, in which the density is stated."""
    rng, size = np.random.default_rng(2), problem.model.size
    poses = problem.optimum.poses.size

    def volume(at: Float) -> float:
        columns = []
        for axis in 1e-6 * np.eye(size):
            ends = [unknowns(problem, split(at + sign * axis)) for sign in (1.0, -1.0)]
            columns.append((ends[0] - ends[1]) / 2e-6)
        return float(np.linalg.slogdet(np.array(columns))[1])

    def split(flat: Float) -> Step:
        return flat[:poses].reshape(-1, 3), flat[poses:].reshape(-1, 2)

    far = np.concatenate([each.ravel() for each in problem.posterior.draw(rng)])
    assert volume(far) == pytest.approx(volume(np.zeros(size)), abs=1e-6)


def test_proposals_have_the_covariance_of_the_linear_model(problem: Problem):
    rng = np.random.default_rng(3)
    newest = np.array([problem.posterior.draw(rng)[0][-1] for _ in range(DRAWS)])
    assert problem.optimum.pose_covs is not None
    squares = float(np.einsum("ni,ij,nj->", newest, np.linalg.inv(problem.optimum.pose_covs[-1]), newest))
    assert FALSE_ALARM / 2 < chi2.cdf(squares, 3 * DRAWS) < 1 - FALSE_ALARM / 2


def test_a_walk_is_the_same_again_and_moves(problem: Problem):
    poses, accepted = sampled(problem.posterior, zero(problem), 100, 5)
    again, _ = sampled(problem.posterior, zero(problem), 100, 5)
    np.testing.assert_array_equal(poses, again)
    assert 0.1 < accepted < 1.0
    assert len(np.unique(poses[:, 0])) == pytest.approx(100 * accepted, abs=2)
