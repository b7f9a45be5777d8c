"""Filters with their own noise or association: right ones fail no check, and most bugs are still found."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

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


def test_the_table_of_inputs_is_on_the_page():
    page = (Path(__file__).parents[3] / "docs/your_filter.md").read_text(encoding="utf-8")
    table = page.split("| check | needs |\n|---|---|\n")[1].split("\n\n")[0]
    rows = [line.strip("| ").replace("`", "").split(" | ") for line in table.splitlines()]
    shown = {name: needs for names, needs in rows for name in names.split(", ")}
    assert shown == {each.name: ", ".join(each.needs) for each in CHECKS if each.needs}


ALL_NOISE: set[Need] = {"odometry noise", "observation noise"}


def own_prior(recording: Recording) -> Estimate:
    return own_noise(replace(recording, prior_cov=Q))


@pytest.mark.parametrize(
    ("estimator", "ignored"),
    [
        (ekf_slam, set[Need]()),
        (own_noise, ALL_NOISE),
        (partial(own_noise, Q=np.zeros((3, 3))), {"observation noise"}),
        (partial(own_noise, R=1e-20 * np.eye(2)), {"odometry noise"}),
        (partial(seeded_ekf, bug="start with no uncertainty"), set[Need]()),
        (own_prior, {*ALL_NOISE, "prior"}),
        (dead_reckoning, set[Need]()),
    ],
    ids=["none", "noise", "no Q at all", "no R at all", "no prior at all", "its own prior", "no observations"],
)
def test_inputs_that_a_filter_ignores(estimator: Estimator, ignored: set[Need]):
    assert ignored_inputs(Subject("mine", estimator)) == ignored


def test_random_estimates_ignore_nothing():
    rng = np.random.default_rng(0)

    def jittered(recording: Recording) -> Estimate:
        right = own_noise(recording)
        return replace(right, poses=right.poses + 1e-9 * rng.normal(size=right.poses.shape))

    assert ignored_inputs(Subject("mine", jittered)) == set()


@pytest.mark.parametrize("scale", [1.0, *in_full([0.1, 10.0])])
def test_a_right_filter_with_its_own_noise_fails_no_check(scale: float):
    for seed in range(5):
        found = failed(partial(own_noise, Q=scale * Q, R=scale * R), seed)
        assert found == (set(), UNJUDGED)


def test_the_reason_names_the_ignored_noise():
    verdicts = {each.name: each for each in check_estimator("mine", own_noise, 0, CHECKS)}
    assert verdicts["time-step"].blame == "not judged: it ignores the odometry noise of the recording"
    only_r = {
        each.name: each.blame for each in check_estimator("mine", partial(own_noise, Q=np.zeros((3, 3))), 0, CHECKS)
    }
    assert only_r["measurement-noise"] == "not judged: it ignores the observation noise of the recording"


@pytest.mark.full  # bugs of other filters are usual
@pytest.mark.parametrize("bug", SEEDED)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # bugs may overflow
def test_bugs_of_a_filter_with_its_own_noise(bug: str):
    for seed in range(2):
        broken, _ = failed(partial(own_noise, bug=bug), seed)
        assert broken == (set() if bug in HIDDEN else {ELSEWHERE.get(bug, SEEDED[bug])})


def associating(recording: Recording) -> Estimate:
    """A filter that ignores ids, and shows its map only without ids."""
    found = ekf_slam(replace(recording, landmark=None))
    return found if recording.landmark is None else Estimate("filtered", found.poses, found.pose_covs)


def merging(recording: Recording) -> Estimate:
    """A filter with its own noise that takes every observation for the first landmark."""
    ids = np.zeros(len(recording.observation), np.int64)
    found = own_noise(replace(recording, landmark=ids))
    return found if recording.landmark is None else Estimate("filtered", found.poses, found.pose_covs)


def test_a_filter_that_associates_by_itself():
    assert ignored_inputs(Subject("mine", associating)) == {"ids"}
    for seed in range(5):
        broken, unjudged = failed(associating, seed)
        assert broken == set()
        assert {"permuted-ids"} <= unjudged
        assert not unjudged & {"truth-recovered", "prediction-jacobian", "odometry-noise-size", "measurement-noise"}


def test_mixed_landmarks_are_no_failure_but_a_wrong_jacobian_is():
    verdicts = {each.name: each for each in check_estimator("mine", merging, 0, CHECKS)}
    assert not [each.name for each in verdicts.values() if each.is_failure]
    why = "not judged: its own association may have confused landmarks"
    assert verdicts["truth-recovered"].blame == why

    def wrong(recording: Recording) -> Estimate:
        found = seeded_ekf(
            replace(recording, landmark=np.zeros(len(recording.observation), np.int64)), "wrong sign in F"
        )
        return found if recording.landmark is None else Estimate("filtered", found.poses, found.pose_covs)

    assert failed(wrong)[0] == {"prediction-jacobian"}
