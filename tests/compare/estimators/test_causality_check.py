"""Estimates that use the future are refused; others pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import Limits, ask, with_limits
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import EXAMPLES, short

pytestmark = pytest.mark.slow

HEAD = """
from dataclasses import replace
import numpy as np
from slamgauge import Estimate, chain

def dead_reckoning(recording):  # that of slamgauge would load a compiler in every process
    covs = np.cumsum([recording.prior_cov, *recording.odometry_cov], axis=0)
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry), covs)

def batch(recording):
    from slamgauge import batch
    return batch(recording)

def later(rows):
    return np.concatenate([rows[1:], rows[-1:]])

"""


def run(what: str, recording: Recording | None = None) -> Estimate:
    (asked,) = with_limits(ask([f"mine={what}"]), Limits(120.0), strict=True)
    return run_estimator("mine", load(asked, announced=False), recording or short())[0]


def written(folder: Path, source: str) -> str:
    (folder / "mine.py").write_text(HEAD + source)
    return f"{folder / 'mine.py'}:estimate"


DRAWN = """
def estimate(recording):
    draw, right = np.random.default_rng({seed}), dead_reckoning(recording)
    return replace(right, poses=right.poses + np.array([draw.normal(0.0, 0.1, 3) for _ in right.poses]))
"""
REMEMBERS = """
known = {}
def estimate(recording):
    right = dead_reckoning(recording)
    known.setdefault("poses", later(right.poses))
    return replace(right, poses=known["poses"][: len(right.poses)])
"""
GUESSES = """
def estimate(recording):
    right = dead_reckoning(recording)
    is_end = np.arange(len(right.poses)) % 20 == 0  # a quarter of the recording
    return replace(right, poses=np.where(is_end[:, None], right.poses, later(right.poses)))
"""


def changed(change: str) -> str:
    return f"def estimate(recording):\n    right = dead_reckoning(recording)\n    return replace(right, {change})"


@pytest.mark.parametrize(
    "source",
    [
        f"{EXAMPLES}/student_ekf.py:ekf_slam",
        changed("pose_covs=None"),
        "def estimate(recording): return batch(recording)",
        DRAWN.format(seed=3),
    ],
    ids=["step function", "no covariances", "smoothed and declared as such", "random and seeded"],
)
def test_estimates_that_use_only_the_past_pass(tmp_path: Path, source: str):
    assert len(run(source if ".py" in source else written(tmp_path, source)).poses) == short().steps + 1


@pytest.mark.parametrize(
    ("source", "what"),
    [
        (
            changed("poses=later(right.poses)"),
            r"from the recording up to step (\d+) alone, the pose of step \1 is another, \S+ m or rad away; store",
        ),
        (
            "def estimate(recording): return replace(batch(recording), kind='filtered')",
            r"from the recording up to step \d+ alone, the pose of step",
        ),
        (changed("pose_covs=later(right.pose_covs)"), r"the covariance of step \d+ is another; store a pose"),
        (REMEMBERS, r"from the recording up to step (\d+) alone, the pose of step \1"),
        ("def estimate(recording): return dead_reckoning(recording.first(3))", "returned 4 poses"),
        (GUESSES, "uses the future"),  # no code knows the steps at which its other runs end
        (DRAWN.format(seed=""), "differ from run to run; seed its random numbers"),
    ],
    ids=["shifted", "smoothed", "shifted covariances", "remembers", "another length", "guesses", "random"],
)
def test_estimates_that_use_the_future_are_refused(tmp_path: Path, source: str, what: str):
    with pytest.raises(UserError, match=rf"^estimator mine: .*{what}"):
        run(written(tmp_path, source), short("q1-short-dense", "trajectory.duration=8"))
