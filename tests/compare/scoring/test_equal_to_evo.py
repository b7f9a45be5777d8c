"""Errors of trajectory files equal those of `evo` without alignment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics
from evo.tools.file_interface import read_tum_trajectory_file

from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.scoring.consistency import distances, pose_errors, step_errors
from slamgauge.compare.scoring.intervals import rms
from slamgauge.compare.storage.trajectories import write_tum
from slamgauge.se2 import chain
from tests.reference.given import given
from tests.reference.random_recordings import random_recording


@pytest.mark.parametrize("seed", range(10))
def test_ate_and_rpe(seed: int, tmp_path: Path):
    truth, recording = random_recording(seed, steps=60)
    path = given(truth.poses)
    turned = np.array([0.1 * seed, -0.2, 0.1 * seed])
    write_tum(tmp_path / "truth.tum", recording.stamps, path)
    write_tum(tmp_path / "mine.tum", recording.stamps, chain(recording.prior_mean + turned, recording.odometry))
    poses = load_stored(tmp_path / "mine.tum", recording).estimate.poses

    read = [read_tum_trajectory_file(tmp_path / name) for name in ("truth.tum", "mine.tum")]
    for metric, errors in (
        (metrics.APE, distances(pose_errors(path, poses))),
        (metrics.RPE, step_errors(path, poses)),
    ):
        theirs = metric(metrics.PoseRelation.translation_part)
        theirs.process_data(tuple(read))
        assert rms(errors) == pytest.approx(theirs.get_statistic(metrics.StatisticsType.rmse), abs=1e-9, rel=0)
        assert given(rms(errors)) > 1e-3
