"""Errors of trajectory files equal those of `evo` without alignment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from evo.tools.file_interface import read_tum_trajectory_file

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.scoring.consistency import distances, pose_errors, step_errors
from slamgauge.compare.scoring.intervals import rms
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.se2 import chain
from tests.reference.random_recordings import random_recording


def evo_rms(metric: metrics.PE, reference: PoseTrajectory3D, estimate: PoseTrajectory3D) -> float:
    metric.process_data((reference, estimate))
    return metric.get_statistic(metrics.StatisticsType.rmse)


@pytest.mark.parametrize("seed", range(10))
def test_ate_and_rpe(seed: int, tmp_path: Path):
    truth, recording = random_recording(seed, steps=60)
    assert truth.poses is not None
    turned = np.array([0.1 * seed, -0.2, 0.1 * seed])
    write_tum(tmp_path / "truth.tum", recording.stamps, truth.poses)
    write_tum(tmp_path / "mine.tum", recording.stamps, chain(recording.prior_mean + turned, recording.odometry))
    poses = load_stored(tmp_path / "mine.tum", recording).estimate.poses

    reference = read_tum_trajectory_file(tmp_path / "truth.tum")
    estimate = read_tum_trajectory_file(tmp_path / "mine.tum")
    ate, rpe = metrics.APE(metrics.PoseRelation.translation_part), metrics.RPE(metrics.PoseRelation.translation_part)
    equal(rms(distances(pose_errors(truth.poses, poses))), evo_rms(ate, reference, estimate))
    equal(rms(step_errors(truth.poses, poses)), evo_rms(rpe, reference, estimate))


def equal(ours: float | Float | None, theirs: float) -> None:
    assert ours is not None
    assert theirs > 1e-3
    assert abs(ours - theirs) < 1e-9
