"""Filters with their own noise or association: right ones fail no check, and most bugs are still found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from slamgauge import Estimate, Recording, dead_reckoning
from slamgauge.arrays import Float
from slamgauge.compare.checks.check import Need, Subject
from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.checks.ignored_inputs import ignored_inputs
from slamgauge.ekf import ekf_slam
from slamgauge.estimate import Estimator
from tests.marks import in_full
from tests.reference.seeded_bugs import SEEDED, seeded_ekf

pytestmark = pytest.mark.slow

Q, R = np.diag([0.03, 0.01, 0.02]) ** 2, np.diag([0.1, 0.05]) ** 2
UNJUDGED = {
    *("odometry-noise-size", "time-step", "measurement-noise", "zero-prior", "sound-covariances"),
    *("standing-robot", "standing-robot-in-noise"),
}
# bugs that another check than the named one finds in a filter with its own noise, and bugs that no check finds
ELSEWHERE = {"wrong sign of y in H of the pose": "rigid-motion"}
HIDDEN = {
    *("sigma for variance in Q", "Q scaled by the time step", "inverse of the prior", "gain in single precision"),
    *("R not added", "H of the range not divided by it"),
}


def own_noise(recording: Recording, bug: str = "", Q: Float = Q, R: Float = R) -> Estimate:
    """The textbook filter with its own noise."""
    Q_all, R_all = np.tile(Q, (recording.steps, 1, 1)), np.tile(R, (len(recording.observation), 1, 1))
    return seeded_ekf(replace(recording, odometry_cov=Q_all, observation_cov=R_all), bug)


def failed(estimator: Estimator, seed: int = 0) -> tuple[set[str], set[str]]:
    """Return the names of failed checks, and of those that do not judge."""
    verdicts = check_estimator("mine", estimator, seed, CHECKS)
    return {each.name for each in verdicts if each.is_failure}, {each.name for each in verdicts if each.passed is None}


ALL_NOISE: set[Need] = {"odometry noise", "observation noise"}


def own_prior(recording: Recording) -> Estimate:
    return own_noise(replace(recording, prior_cov=Q))


def jittered(recording: Recording) -> Estimate:
    right = own_noise(recording)
    return replace(right, poses=right.poses + 1e-9 * np.random.default_rng().normal(size=right.poses.shape))


@pytest.mark.parametrize(
    ("estimator", "ignored"),
    [
        (ekf_slam, set[Need]()),
        (own_noise, ALL_NOISE),
        (partial(own_noise, R=np.diag([1.0, 0.05]) ** 2), ALL_NOISE),
        (partial(own_noise, Q=np.zeros((3, 3))), {"observation noise"}),
        (partial(own_noise, R=1e-20 * np.eye(2)), {"odometry noise"}),
        (partial(seeded_ekf, bug="start with no uncertainty"), set[Need]()),
        (own_prior, {*ALL_NOISE, "prior"}),
        (dead_reckoning, set[Need]()),
        (jittered, set[Need]()),
    ],
    ids=["none", "noise", "ranges", "no Q", "no R", "no prior", "its own prior", "no observations", "random estimates"],
)
def test_inputs_that_a_filter_ignores(estimator: Estimator, ignored: set[Need]):
    assert ignored_inputs(Subject("mine", estimator)) == ignored


@pytest.mark.parametrize("scale", [1.0, *in_full([0.1, 10.0])])
def test_a_right_filter_with_its_own_noise_fails_no_check(scale: float):
    for seed in range(5):
        found = failed(partial(own_noise, Q=scale * Q, R=scale * R), seed)
        assert found == (set(), UNJUDGED)


@pytest.mark.full  # bugs of other filters are usual
@pytest.mark.parametrize("bug", SEEDED)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # bugs may overflow
def test_bugs_of_a_filter_with_its_own_noise(bug: str):
    for seed in range(2):
        broken, _ = failed(partial(own_noise, bug=bug), seed)
        assert broken == (set() if bug in HIDDEN else {ELSEWHERE.get(bug, SEEDED[bug])})


def without_ids(recording: Recording, run: Estimator) -> Estimate:
    """Return the estimate of a filter that ignores ids, and shows its map only without ids."""
    found = run(recording)
    return found if recording.landmark is None else Estimate("filtered", found.poses, found.pose_covs)


def associating(recording: Recording) -> Estimate:
    return without_ids(recording, lambda given: ekf_slam(replace(given, landmark=None)))


def merging(recording: Recording, bug: str = "", run: Callable[..., Estimate] = own_noise) -> Estimate:
    """A filter that takes every observation for the first landmark."""
    ids = np.zeros(len(recording.observation), np.int64)
    return without_ids(recording, lambda given: run(replace(given, landmark=ids), bug))


def test_a_filter_that_associates_by_itself():
    assert ignored_inputs(Subject("mine", associating)) == {"ids"}
    for seed in range(5):
        broken, unjudged = failed(associating, seed)
        assert broken == set() and "permuted-ids" in unjudged
        assert not unjudged & {"truth-recovered", "prediction-jacobian", "odometry-noise-size", "measurement-noise"}


def test_mixed_landmarks_are_no_failure_but_a_wrong_jacobian_is():
    verdicts = {each.name: each for each in check_estimator("mine", merging, 0, CHECKS)}
    assert not [each.name for each in verdicts.values() if each.is_failure]
    why = "not judged: its own association may have confused landmarks"
    assert verdicts["truth-recovered"].blame == why
    assert failed(partial(merging, bug="wrong sign in F", run=seeded_ekf))[0] == {"prediction-jacobian"}
