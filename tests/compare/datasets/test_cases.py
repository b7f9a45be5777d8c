"""Logs that version 0.5 treated wrongly: each gives the answer of its README."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.files import load_recording

CASES = Path(__file__).parents[3] / "../shared/cases/logs"
pytestmark = pytest.mark.skipif(not CASES.exists(), reason=f"{CASES} is not there")

WRONG_CAUSES = ("are variances", "are standard deviations", "check units", "times its stated noise", "logarithms")


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (("csv", "obs_noise_90pct"), 0, "do not fit their stated noise"),
        (("csv", "off1_noise13"), 0, "if their stamps are 1 s late; give both files the same clock"),
        (
            ("csv", "csv_heading_unwrapped_increments"),
            2,
            "line 107: the robot turns by -6.25 rad in one row; these",
        ),
        (("csv", "csv_range_only"), 2, "range-only landmarks are not supported"),
        (("csv", "csv_rangezero_nodetect"), 0, "116 observations have range 0 m (no detection?), the first in line"),
        (("csv", "csv_iso"), 2, "odometry from 1714564800 to 17145648"),  # its observations count from 0 s
        (("csv", "unix_gap"), 0, "from 1700000"),
        (("g2o", "g2o/isam_edge2.txt", "--isam"), 0, "3 steps, 4 observations"),
        (("g2o", "g2o/fix_mid.g2o"), 0, "pose 2 in mid-path is fixed"),
        (("g2o", "g2o/fix_landmark.g2o"), 2, "line 2: landmark 10 is fixed, which is not supported"),
        (("g2o", "g2o/precise_100.g2o"), 0, "100 steps, 1841 observations"),
    ],
)
def test_causes_at_import(
    words: tuple[str, ...], status: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    form, name, *options = words
    assert main(["import", form, str(CASES / name), *options, "--out", str(tmp_path / "out")]) == status
    printed = capsys.readouterr().err
    assert said in printed
    assert not any(wrong in printed for wrong in WRONG_CAUSES)
    assert "e+09" not in printed
    assert name != "g2o/precise_100.g2o" or "warning" not in printed


def test_a_square_root_of_the_information_is_upper_triangular(tmp_path: Path):
    assert main(["import", "g2o", str(CASES / "g2o/isam_edge2.txt"), "--isam", "--out", str(tmp_path / "out")]) == 0
    recording = load_recording(tmp_path / "out/recording.npz")
    np.testing.assert_allclose(recording.odometry_cov[0], np.diag([0.01, 0.01, 0.0025]), rtol=1e-12)
    np.testing.assert_allclose(recording.observation_cov[0], np.eye(2) / 49, rtol=1e-12)


def test_sigmas_of_rows_are_used_and_zero_ranges_are_left_out_on_request(tmp_path: Path):
    assert main(["import", "csv", str(CASES / "csv_per_row_sigma"), "--out", str(tmp_path / "rows")]) == 0
    covs = load_recording(tmp_path / "rows/recording.npz").observation_cov
    np.testing.assert_allclose(np.sqrt(covs[0].diagonal()), [0.0990, 0.0175], rtol=1e-12)
    words = ["import", "csv", str(CASES / "csv_rangezero_nodetect"), "--set", "observations.drop_zero_ranges=true"]
    assert main([*words, "--out", str(tmp_path / "zero")]) == 0
    recording = load_recording(tmp_path / "zero/recording.npz")
    assert len(recording.observation) == 808 - 116
    assert (recording.observation[:, 0] > 0.0).all()


def test_a_column_called_time_is_the_stamp(tmp_path: Path):
    assert main(["import", "csv", str(CASES / "car"), "--out", str(tmp_path / "car")]) == 0
    recording = load_recording(tmp_path / "car/recording.npz")
    content = (CASES / "estimates/e_time.csv").read_text().splitlines()
    start = float(content[1].split(",")[0]) - recording.stamps[0]
    rows = [line.split(",") for line in content[1:]]
    shifted = [",".join([f"{float(row[0]) - start:.9f}", *row[1:]]) for row in rows]
    (tmp_path / "e.csv").write_text("\n".join([content[0], *shifted]) + "\n")
    few = recording.first(min(recording.steps, len(rows) - 2))
    assert load_stored(tmp_path / "e.csv", few).estimate.poses.shape == (few.steps + 1, 3)


def test_an_exception_of_a_built_in_estimator_costs_no_other_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import", "csv", str(CASES / "zero_range_isam2"), "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "out/recording.npz"), "--estimators", "ekf,isam2"]) == 1
    printed = capsys.readouterr().out
    assert "estimator isam2: LinAlgError" in " ".join(printed.split())
    assert "\nekf " in printed


def test_trajectories_are_scored_at_their_own_stamps_and_in_their_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Every pose and every 20th pose of a filter have about the same NEES; a body frame is warned of."""
    assert main(["import", "csv", str(CASES / "car"), "--out", str(tmp_path / "car")]) == 0
    words = ["evaluate", str(tmp_path / "car/recording.npz"), "--estimators", "dead-reckoning", "--json", "--estimates"]
    files = {name: str(CASES / f"car_estimates/car_{name}.tum") for name in ("1", "20", "body")}
    capsys.readouterr()
    assert main([*words, *(f"e{name}={path}" for name, path in files.items())]) == 0
    printed = capsys.readouterr()
    scores = json.loads(printed.out)["estimators"]
    found = {name: (scores[f"e{name}"]["nees_pose"], scores[f"e{name}"]["ate_m"]) for name in files}
    np.testing.assert_allclose(found["1"], (3.92, 0.329), rtol=0.003)
    np.testing.assert_allclose(found["20"], (3.96, 0.327), rtol=0.003)
    assert "31 poses are compared, at their own stamps; the recording has 601 steps" in printed.err
    assert "3.92 if its covariances are in the body frame" in printed.err
    assert main([*words, f"body={files['body']}", "--covariance-frame", "body"]) == 0
    assert json.loads(capsys.readouterr().out)["estimators"]["body"]["nees_pose"] == pytest.approx(3.92, rel=0.003)


def test_folders_whose_names_are_not_utf_8_have_no_traceback(tmp_path: Path):
    folder = tmp_path / os.fsdecode(b"log\xff")
    shutil.copytree(CASES / "unix_gap", folder)
    assert main(["import", "csv", str(folder), "--out", str(tmp_path / os.fsdecode(b"out\xff"))]) == 0
    assert "udcff" in (tmp_path / os.fsdecode(b"out\xff") / "recording.toml").read_text()
