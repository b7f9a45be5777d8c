"""Estimates that use the future are refused; others pass."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import Isolation, ask, isolated
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.course_files import STYLES

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
    (asked,) = isolated(ask([f"mine={what}"]), Isolation(120.0, strict=True))
    return run_estimator("mine", load(asked, announced=False), recording or short())[0]


def written(folder: Path, source: str) -> str:
    (folder / "mine.py").write_text(HEAD + dedent(source))
    return f"{folder / 'mine.py'}:estimate"


@pytest.mark.parametrize(
    "source",
    [
        f"{EXAMPLES}/student_ekf.py:ekf_slam",
        "def estimate(recording): return replace(dead_reckoning(recording), pose_covs=None)",
        "def estimate(recording): return batch(recording)",
        """
        def estimate(recording):
            draw = np.random.default_rng(3)
            right = dead_reckoning(recording)
            shaken = right.poses + np.array([draw.normal(0.0, 0.1, 3) for _ in right.poses])
            return replace(right, poses=shaken)
        """,
    ],
    ids=["step function", "no covariances", "smoothed and declared as such", "random and seeded"],
)
def test_estimates_that_use_only_the_past_pass(tmp_path: Path, source: str):
    assert len(run(source if ".py" in source else written(tmp_path, source)).poses) == short().steps + 1


@pytest.mark.parametrize(
    ("source", "what"),
    [
        (
            "def estimate(recording):\n"
            "    right = dead_reckoning(recording)\n"
            "    return replace(right, poses=later(right.poses))",
            r"from the recording up to step (\d+) alone, the pose of step \1 is another, \S+ m or rad away; store",
        ),
        (
            "def estimate(recording): return replace(batch(recording), kind='filtered')",
            r"from the recording up to step \d+ alone, the pose of step",
        ),
        (
            "def estimate(recording):\n"
            "    right = dead_reckoning(recording)\n"
            "    return replace(right, pose_covs=later(right.pose_covs))",
            r"the covariance of step \d+ is another; store a pose",
        ),
        (
            """
            known = {}
            def estimate(recording):
                right = dead_reckoning(recording)
                known.setdefault("poses", later(right.poses))
                return replace(right, poses=known["poses"][: len(right.poses)])
            """,
            r"from the recording up to step (\d+) alone, the pose of step \1",
        ),
        (
            "def estimate(recording): return dead_reckoning(recording.first(3))",
            "returned 4 poses",
        ),
    ],
    ids=["shifted", "smoothed", "shifted covariances", "remembers", "another length"],
)
def test_estimates_that_use_the_future_are_refused(tmp_path: Path, source: str, what: str):
    with pytest.raises(UserError, match=rf"^estimator mine: .*{what}"):
        run(written(tmp_path, source))


def test_no_code_knows_the_steps_at_which_its_other_runs_end(tmp_path: Path):
    recording = short("q1-short-dense", "trajectory.duration=20")
    source = f"""
        def estimate(recording):
            right = dead_reckoning(recording)
            is_end = np.arange(len(right.poses)) % {recording.steps // 4} == 0
            return replace(right, poses=np.where(is_end[:, None], right.poses, later(right.poses)))
    """
    with pytest.raises(UserError, match="uses the future"):
        run(written(tmp_path, source), recording)


def test_unseeded_random_numbers_are_another_error(tmp_path: Path):
    source = """
        def estimate(recording):
            right = dead_reckoning(recording)
            return replace(right, poses=right.poses + np.random.default_rng().normal(0.0, 0.1, right.poses.shape))
    """
    with pytest.raises(UserError, match="differ from run to run; seed its random numbers"):
        run(written(tmp_path, source))


def test_a_diverging_file_of_the_octave_course_does_not_use_the_future(tmp_path: Path):
    """Its errors grow from rounding, which would differ if its arrays had room for landmarks that come later."""
    style = STYLES["dicts from 1"]
    wrong = style.source.replace("mu + (K @ difference)", "mu - (K @ difference)")
    assert wrong != style.source
    (tmp_path / "mine.py").write_text(wrong)
    estimate = run(f"{tmp_path / 'mine.py'}:prediction_step", short("q1-short-dense", "trajectory.duration=6"))
    assert abs(estimate.poses).max() > 1e6
