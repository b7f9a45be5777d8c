"""Stored trajectories are scored at their own stamps, and aligned or rotated on request."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamgauge.arrays import Float
from slamgauge.compare.estimators.stored_trajectory import stored_estimate
from slamgauge.compare.scoring.own_stamps import optimum_at, rigid_transform, truth_at
from slamgauge.compare.storage.csv_folder import POSE, POSE_COV, write_rows
from slamgauge.compare.storage.files import save
from slamgauge.compare.storage.trajectories import Trajectory, write_tum
from slamgauge.ekf import ekf_slam
from slamgauge.graph_baseline import causal
from slamgauge.se2 import between, compose, pose_rotation
from tests.reference.command_line import run
from tests.reference.given import given
from tests.reference.random_recordings import random_recording

TRUTH, RECORDING = random_recording(3, steps=40)
STAMPS = RECORDING.stamps
PATH = given(TRUTH.poses)


def arc(times: Float) -> Float:
    """Return poses on a circle of 2 m radius at 1 m/s."""
    return np.column_stack([2.0 * np.sin(times / 2.0), 2.0 - 2.0 * np.cos(times / 2.0), times / 2.0])


CIRCLE = arc(STAMPS)
ON_THE_ARC = replace(TRUTH, poses=CIRCLE), replace(RECORDING, odometry=between(CIRCLE[:-1], CIRCLE[1:]))
FILTERED = ekf_slam(RECORDING)
COVS = given(FILTERED.pose_covs)


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    save(tmp_path / "recording.npz", RECORDING)
    save(tmp_path / "truth.npz", TRUTH)
    return tmp_path


def scores(
    folder: Path, capsys: pytest.CaptureFixture[str], *files: str, more: tuple[str, ...] = (), part: str = "estimators"
) -> dict[str, Any]:
    """Return a part of the JSON that `evaluate` prints; estimates in files of the folder have their first names."""
    given_files = [f"{name.partition('.')[0]}={folder / name}" for name in files]
    command = ["evaluate", folder / "recording.npz", "--estimators", "causal,batch", "--json", *more]
    capsys.readouterr()
    assert run(*command, *(["--estimates", *given_files] if files else [])) == 0
    return json.loads(capsys.readouterr().out)[part]


@pytest.mark.parametrize("shift", [-0.04, 0.03, 0.049])
def test_a_perfect_trajectory_on_an_arc_has_no_error_at_stamps_between_the_steps(shift: float) -> None:
    """Straight lines between its poses, or between those of the truth, would be wrong by up to 0.3 mm."""
    truth, recording = ON_THE_ARC
    found = stored_estimate(Trajectory("mine", STAMPS + shift, arc(STAMPS + shift)), recording)
    own = given(found.own)
    reference = given(truth_at(own.stamps, truth, recording))
    inside = slice(1, -1)  # beyond the ends the truth is not known
    assert_allclose(own.estimate.poses[inside], given(reference.poses)[inside], atol=1e-12)
    assert_allclose(found.estimate.poses[inside], given(truth.poses)[inside], atol=1e-12)


def test_a_filtered_optimum_between_steps_follows_the_odometry() -> None:
    optimum = causal(RECORDING)
    assert optimum_at(STAMPS, optimum, RECORDING) == optimum
    near = np.full(41, np.nan)
    near[[10, 21]] = STAMPS[10] + 0.05, STAMPS[21] - 0.05
    moved = optimum_at(near, optimum, RECORDING).poses
    for row, begin in ((10, 10), (21, 20)):
        rest = between(moved[row], compose(optimum.poses[begin], RECORDING.odometry[begin]))
        assert np.hypot(*rest[:2]) == pytest.approx(np.hypot(*RECORDING.odometry[begin, :2]) / 2.0, rel=0.05)


def test_formats_thinned_offset_and_turned(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A filter's poses as TUM and CSV, late by a second, and every third one, have the scores of the filter."""
    rows = np.column_stack([STAMPS, FILTERED.poses, COVS[:, *np.triu_indices(3)]])
    header = ("stamp", *POSE, *POSE_COV)
    write_tum(run_folder / "tum.tum", STAMPS, FILTERED.poses, COVS)
    write_rows(run_folder / "late.csv", header, rows - np.eye(1, rows.shape[1]))  # a second
    write_rows(run_folder / "third.csv", header, rows[::3])
    save(run_folder / "whole.npz", FILTERED)
    found = scores(run_folder, capsys, "whole.npz", "tum.tum", "third.csv")
    late = scores(run_folder, capsys, "late.csv", more=("--time-offset", "1"))["late"]
    for key in ("ate_m", "nees_pose", "ratio_to_optimum", "mahalanobis_to_optimum", "final_position_error_m"):
        assert_allclose([found["tum"][key], late[key]], found["whole"][key], rtol=1e-9)
    third = slice(None, None, 3)
    off, best = (np.hypot(*(each.poses - PATH)[third, :2].T) for each in (FILTERED, causal(RECORDING)))
    assert found["third"]["ate_m"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-12)
    assert found["third"]["ratio_to_optimum"] == pytest.approx(np.sqrt(np.mean(off**2) / np.mean(best**2)), rel=1e-9)
    assert found["third"]["final_position_error_m"] == pytest.approx(off[-1], rel=1e-12)


def test_body_frame_and_alignment(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turns, transform = pose_rotation(FILTERED.poses[:, 2]), np.array([5.0, -3.0, 0.7])
    turn = pose_rotation(transform[2])
    save(run_folder / "whole.npz", FILTERED)
    write_tum(run_folder / "body.tum", STAMPS, FILTERED.poses, turns.swapaxes(1, 2) @ COVS @ turns)
    write_tum(run_folder / "moved.tum", STAMPS, compose(transform, FILTERED.poses), turn @ COVS @ turn.T)
    found = scores(run_folder, capsys, "whole.npz", "moved.tum", more=("--align", "se2"))
    body = scores(run_folder, capsys, "body.tum", more=("--covariance-frame", "body"))["body"]
    assert body["nees_pose"] == pytest.approx(found["whole"]["nees_pose"], rel=1e-9)
    assert found["moved"]["ate_m"] > 3.0
    assert found["moved-aligned"]["ate_m"] <= found["whole"]["ate_m"]
    for key in ("ate_m", "nees_pose"):
        assert found["moved-aligned"][key] == pytest.approx(found["whole-aligned"][key], rel=1e-9)


def test_covariances_of_another_frame_are_warned_of(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A narrow ellipse along the heading, as the sampled errors of a robot on a circle are."""
    errors = np.random.default_rng(0).normal(0.0, [0.5, 0.02, 0.02], (41, 3))
    write_tum(run_folder / "m.tum", STAMPS, compose(CIRCLE, errors), np.tile(np.diag([0.25, 4e-4, 4e-4]), (41, 1, 1)))
    for name, each in zip(("truth.npz", "recording.npz"), ON_THE_ARC, strict=True):
        save(run_folder / name, each)
    words = ["evaluate", run_folder / "recording.npz", "--estimators", "dead-reckoning", "--estimates"]
    for more, is_warned in (([], True), (["--covariance-frame", "body"], False)):
        assert run(*words, f"mine={run_folder / 'm.tum'}", *more) == 0
        assert ("covariances are in the body frame" in capsys.readouterr().err) == is_warned


def test_the_rigid_transform_is_that_of_evo() -> None:
    from evo.core.geometry import umeyama_alignment

    rng = np.random.default_rng(5)
    points, targets = rng.normal(size=(2, 20, 2))
    turn, move, _ = umeyama_alignment(points.T, targets.T)
    transform = rigid_transform(points, targets)
    assert_allclose(transform, [*move, np.arctan2(turn[1, 0], turn[0, 0])], atol=1e-12)


def test_twins_are_compared_at_the_same_steps(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A consistent filter is consistent, too, if every fifth pose is given; on straight lines it was overconfident."""
    write_tum(run_folder / "m.tum", STAMPS[::5], FILTERED.poses[::5], COVS[::5])
    found = scores(run_folder, capsys, "m.tum", more=("--twins", "19"), part="without_truth")
    assert found["m"]["verdict"] == "consistent"


def test_a_truth_without_headings_gives_position_errors_and_position_nees(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = scores(run_folder, capsys)["causal"]
    save(run_folder / "truth.npz", replace(TRUTH, poses=PATH * [1.0, 1.0, np.nan]))
    write_tum(run_folder / "between.tum", STAMPS + 0.02, FILTERED.poses)
    scored = scores(run_folder, capsys, "between.tum")
    found = scored["causal"]
    for key in ("ate_m", "nees_position", "coverage_95", "ratio_to_optimum", "final_position_error_m"):
        assert found[key] == whole[key]
    for key in ("heading_rmse_rad", "nees_pose", "rpe_m"):
        assert found[key] is None
    assert run("evaluate", run_folder / "recording.npz", "--estimators", "causal,batch", "--align", "se2") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "the truth has no headings: heading errors, relative errors and pose NEES are left out" in printed
    assert "NEES xy" in printed
    assert scored["between"]["ate_m"] == pytest.approx(whole["ate_m"], rel=0.5)


def test_options_that_do_not_fit(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(run_folder / "e.npz", FILTERED)
    (run_folder / "truth.npz").unlink()
    words = ["evaluate", run_folder / "recording.npz", "--estimates", f"e={run_folder / 'e.npz'}"]
    for more, message in (
        (["--max-gap", "0"], "time-offset and max-gap: 0 s and 0 s are not a time and a gap above 0; give seconds"),
        (["--time-offset", "nan"], "time-offset and max-gap: nan s and 1 s"),
        (["--align", "se2"], "align: se2 needs true positions"),
    ):
        assert run(*words, *more) == 2
        assert message in capsys.readouterr().err
