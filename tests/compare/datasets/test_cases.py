"""Kinds of logs that version 0.5 treated wrongly, in `../shared/cases/logs`: each gives the right answer."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.g2o_writer import write_g2o
from tests.reference.log_changes import MAPPING, good_log
from tests.reference.random_recordings import recording_of

CASES = Path(__file__).parents[3] / "../shared/cases/logs"
needs_cases = pytest.mark.skipif(not CASES.exists(), reason=f"{CASES} is not there")
WRONG_CAUSES = ("are variances", "are standard deviations", "check units", "times its stated noise", "e+09")


def test_a_right_graph_of_bearings_has_no_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_g2o(tmp_path / "graph.g2o", recording_of("bearing", steps=60))
    assert main(["import", "g2o", str(tmp_path / "graph.g2o"), "--out", str(tmp_path / "out")]) == 0
    assert "warning" not in capsys.readouterr().err


def test_a_packed_bag_is_to_be_unpacked(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "run.bag.bz2").write_bytes(b"BZh9")
    assert main(["import", "bag", str(tmp_path / "run.bag.bz2"), "--out", str(tmp_path / "out")]) == 2
    assert "run.bag.bz2: is a packed file; unpack it, and give the bag" in capsys.readouterr().err


def test_folders_whose_names_are_not_utf_8_have_no_traceback(tmp_path: Path):
    folder, out = tmp_path / os.fsdecode(b"log\xff"), tmp_path / os.fsdecode(b"out\xff")
    folder.mkdir()
    for file, content in good_log().items():
        (folder / file).write_text(content)
    assert main(["import", "csv", str(folder), "--out", str(out)]) == 0
    assert "udcff" in (out / MAPPING).read_text()


@needs_cases
@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (("csv", "obs_noise_90pct"), 0, "do not fit their stated noise"),
        (("csv", "off1_noise13"), 0, "if their stamps are 1 s late; give both files the same clock"),
        (("csv", "csv_heading_unwrapped_increments"), 2, "line 107: the robot turns by -6.25 rad in one row; these"),
        (("csv", "csv_range_only"), 2, "range-only landmarks are not supported"),
        (("csv", "csv_rangezero_nodetect"), 0, "116 observations have range 0 m (no detection?), the first in line"),
        (("csv", "csv_rangezero_nodetect", "--set", "observations.drop_zero_ranges=true"), 0, "692 observations, no"),
        (("csv", "csv_iso"), 0, "observations.csv: stamps are seconds, those of the odometry times"),
        (("csv", "csv_gps_truth"), 0, "the ground truth has no headings"),
        (("csv", "csv_per_row_sigma"), 0, "808 within the steps"),
        (("csv", "unix_gap"), 0, "from 1700000007.9"),
        (("csv", "car"), 0, "600 steps, 1447 observations, with ground truth"),
        (("csv", "zero_range_isam2"), 0, "1 observations have range 0 m"),
        (("g2o", "g2o/isam_edge2.txt", "--isam"), 0, "3 steps, 4 observations"),
        (("g2o", "g2o/fix_mid.g2o"), 0, "pose 2 in mid-path is fixed"),
        (("g2o", "g2o/fix_landmark.g2o"), 2, "line 2: landmark 10 is fixed, which is not supported"),
        (("g2o", "g2o/precise_100.g2o"), 0, "100 steps, 1841 observations"),
    ],
)
def test_files_of_the_kinds(
    words: Sequence[str], status: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    form, name, *options = words
    assert main(["import", form, str(CASES / name), *options, "--out", str(tmp_path / "out")]) == status
    printed = capsys.readouterr().err
    assert said in printed
    assert not any(wrong in printed for wrong in WRONG_CAUSES)
    assert name != "g2o/precise_100.g2o" or "warning" not in printed


@needs_cases
def test_an_exception_of_a_built_in_estimator_costs_no_other_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import", "csv", str(CASES / "zero_range_isam2"), "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "out/recording.npz"), "--estimators", "ekf,isam2"]) == 1
    printed = capsys.readouterr().out
    assert "estimator isam2: LinAlgError" in " ".join(printed.split())
    assert "\nekf " in printed


@needs_cases
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
