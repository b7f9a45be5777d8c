"""`slamgauge export`: written files are read back, by us and by scipy; what cannot be written is one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.estimators.stored_trajectory import load_stored
from slamgauge.compare.storage.files import load_estimate, load_recording, save
from slamgauge.estimate import Estimate
from tests.reference.random_recordings import random_recording

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a run."""
    folder = tmp_path_factory.mktemp("run") / "run"
    words = ("run", "q1-short-dense", "--set", "trajectory.duration=3", "--estimators", "ekf,fej-ekf", "--no-report")
    assert main([*words, "--out", str(folder)]) == 0
    return folder


def export(path: Path, form: str, out: Path, *more: str) -> int:
    return main(["export", form, str(path), "--out", str(out), *more])


def test_a_recording_as_csv_and_g2o(run: Path, tmp_path: Path):
    """Of the folder of a run, of its recording, and of the folder of an import."""
    recording = load_recording(run / "recording.npz")
    assert export(run, "csv", tmp_path / "csv") == 0
    assert read_csv_log(tmp_path / "csv").recording == recording
    assert main(["import", "csv", str(tmp_path / "csv"), "--out", str(tmp_path / "npz")]) == 0
    assert export(tmp_path / "npz", "csv", tmp_path / "again") == 0
    for path in (tmp_path / "csv").glob("*.csv"):
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()
    assert export(run / "recording.npz", "g2o", tmp_path / "graph.g2o", "--lend", "1e-4") == 0
    assert main(["import", "g2o", str(tmp_path / "graph.g2o"), "--out", str(tmp_path / "graph")]) == 0
    back = load_recording(tmp_path / "graph/recording.npz")
    assert_array_equal(back.odometry, recording.odometry)
    assert_array_equal(back.landmark, recording.landmark)


def test_a_run_as_mat(run: Path, tmp_path: Path):
    assert export(run, "mat", tmp_path / "run.mat") == 0
    read: dict[str, Any] = loadmat(tmp_path / "run.mat", simplify_cells=True)
    assert {name for name in read if not name.startswith("__")} == {"recording", "truth", "ekf", "fej_ekf"}
    recording, estimate = load_recording(run / "recording.npz"), load_estimate(run / "estimates/fej-ekf.npz")
    assert read["recording"]["sensor"] == "range-bearing"
    for name in ("stamps", "odometry", "odometry_cov", "observation_step", "observation", "landmark", "prior_cov"):
        assert_array_equal(read["recording"][name], getattr(recording, name))
    assert_array_equal(read["fej_ekf"]["pose_covs"], estimate.pose_covs)
    assert read["fej_ekf"]["kind"] == "filtered"


def test_an_estimate_as_tum_and_csv(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    recording, estimate = load_recording(run / "recording.npz"), load_estimate(run / "estimates/ekf.npz")
    assert export(run / "estimates/ekf.npz", "tum", tmp_path / "ekf.tum") == 0
    back = load_stored(tmp_path / "ekf.tum", recording).estimate
    assert_allclose(back.poses, estimate.poses, atol=1e-12)
    assert_array_equal(back.pose_covs, estimate.pose_covs)
    assert export(run / "estimates/ekf.npz", "csv", tmp_path / "mine.csv") == 0
    back = load_stored(tmp_path / "mine.csv", recording).estimate
    for name in ("poses", "pose_covs", "landmark_ids", "landmarks", "landmark_covs"):
        assert_array_equal(getattr(back, name), getattr(estimate, name))
    bare, out = tmp_path / "elsewhere/bare.npz", tmp_path / "bare.tum"
    bare.parent.mkdir()
    save(bare, Estimate("filtered", poses=estimate.poses))
    assert export(bare, "csv", tmp_path / "bare/bare.csv") == 0
    assert (tmp_path / "bare/bare.csv").read_text().startswith("step,x,y,theta\n0,")
    assert export(bare, "tum", out) == 2
    assert "recording.npz: cannot be read (No such file" in capsys.readouterr().err
    other = tmp_path / "other.npz"
    save(other, random_recording(1)[1])
    assert export(bare, "tum", out, "--recording", str(other)) == 2
    assert "poses, but" in capsys.readouterr().err
    assert export(bare, "tum", out, "--recording", str(run / "recording.npz")) == 0
    assert load_stored(out, recording).estimate.pose_covs is None


@pytest.mark.parametrize(
    ("place", "form", "more", "message"),
    [
        ("", "tum", (), "run: it has 2 estimates; give FOLDER/estimates/NAME.npz"),
        ("estimates/ekf.npz", "g2o", (), "ekf.npz: it is an estimate, not a recording"),
        ("truth.npz", "csv", (), "truth.npz: not a whole Recording: "),
        ("", "csv", ("--columns", "ate_m"), "summary.json: cannot be read"),
        ("metrics.json", "mat", (), "metrics.json: not a whole npz file"),
        ("", "g2o", (), "odometry_cov[0]: is singular"),
        ("", "g2o", ("--lend", "-1"), "lend: -1 is not a small standard deviation"),
    ],
)
def test_what_cannot_be_exported_is_one_line(
    run: Path, place: str, form: str, more: tuple[str, ...], message: str, tmp_path: Path, capsys: Any
):
    assert export(run / place, form, tmp_path / "out", *more) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert message in told
    assert not [*tmp_path.iterdir()]
