"""The course's log of a simulated robot: ranges below zero, its import, its twin and runs of the twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.cli.main import main
from slamgauge.compare.datasets.freiburg import read_freiburg
from slamgauge.compare.storage.files import load_recording, load_truth
from tests.reference.robot_logs import FREIBURG

LANDMARKS = np.array([[2.0, 1.0], [4.0, 3.0], [1.0, 4.0], [6.0, 6.0]])  # m


def written(folder: Path, text: str) -> Path:
    (folder / "sensor_data.dat").write_text(text)
    (folder / "world.dat").write_text(FREIBURG["world.dat"])
    return folder


def course_log(steps: int = 40, seed: int = 3) -> tuple[str, str]:
    """Return sensor_data.dat and world.dat of a robot that turns left on a circle; the last range is negative."""
    rng = np.random.default_rng(seed)
    pose, lines = np.zeros(3), list[str]()
    for _ in range(steps):
        turn = 0.1
        pose += np.array([0.5 * np.cos(pose[2] + turn), 0.5 * np.sin(pose[2] + turn), 2 * turn])
        noisy = rng.normal([turn, 0.5, turn], [0.005, 0.01, 0.005])
        lines.append("ODOMETRY " + " ".join(f"{value:.6f}" for value in noisy))
        for name, (x, y) in enumerate(LANDMARKS - pose[:2], start=1):
            seen = rng.normal([np.hypot(x, y), np.arctan2(y, x) - pose[2]], 0.1)
            lines.append(f"SENSOR {name} {max(seen[0], 0.01):.6f} {seen[1]:.6f}")
    lines[-1] = lines[-1].replace(f"SENSOR {len(LANDMARKS)} ", f"SENSOR {len(LANDMARKS)} -")
    world = "".join(f"{name} {x} {y}\n" for name, (x, y) in enumerate(LANDMARKS, start=1))
    return "\n".join(lines) + "\n\n", world


@pytest.mark.parametrize("value", ["-2.0", "0", "-1e-9"])
def test_an_observation_with_a_range_that_is_not_positive_is_left_out(value: str, tmp_path: Path):
    whole = read_freiburg(written(tmp_path, FREIBURG["sensor_data.dat"])).recording
    text = FREIBURG["sensor_data.dat"].replace("SENSOR 2 3.0", f"SENSOR 2 {value}")
    recording, truth, notes, _, _ = read_freiburg(written(tmp_path, text))
    assert notes == ("1 observation with a range that is not positive was left out (line 3)",)
    assert_array_equal(recording.observation_step, [1, 2])
    assert_array_equal(recording.landmark, [1, 1])
    assert_array_equal(recording.observation, whole.observation[[0, 2]])
    assert_array_equal(recording.odometry, whole.odometry)
    assert truth is not None
    assert_array_equal(truth.association, [1, 1])


@pytest.mark.parametrize(("count", "lines"), [(2, "lines 2, 3"), (7, "lines 2, 3, 4, 5, 6, ...")])
def test_the_note_counts_such_observations_and_names_the_first_lines(count: int, lines: str, tmp_path: Path):
    text = "ODOMETRY 0.1 2.0 -0.3\n" + count * "SENSOR 2 -3.0 1.0\n" + "SENSOR 1 2.0 0.5\n"
    notes = read_freiburg(written(tmp_path, text)).notes
    assert notes == (f"{count} observations with a range that is not positive were left out ({lines})",)


def test_a_log_with_positive_ranges_has_no_note(tmp_path: Path):
    assert read_freiburg(written(tmp_path, FREIBURG["sensor_data.dat"])).notes == ()


def test_import_twin_and_runs_of_the_twin(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    log, world = course_log()
    (tmp_path / "sensor_data.dat").write_text(log)
    (tmp_path / "world.dat").write_text(world)
    imported, twin, run = (str(tmp_path / name) for name in ("imported", "twin", "run"))
    assert main(["import", "freiburg", str(tmp_path), "--out", imported]) == 0
    line = len(log.splitlines()) - 1
    note = f"1 observation with a range that is not positive was left out (line {line})"
    assert capsys.readouterr().err.splitlines()[0] == note
    assert main(["twin", f"{imported}/recording.npz", "--out", twin]) == 0
    assert main(["run", f"{twin}/twin.toml", "--estimators", "ekf,causal", "--out", run]) == 0
    original, simulated = (load_recording(Path(folder) / "recording.npz") for folder in (imported, run))
    assert_array_equal(simulated.observation_step, original.observation_step)
    assert_allclose(simulated.odometry_cov, original.odometry_cov, atol=1e-15)
    assert_allclose(simulated.observation_cov, original.observation_cov, rtol=1e-9)
    places = load_truth(Path(run) / "truth.npz").landmarks
    assert places is not None
    assert 0.0 < np.abs(places - LANDMARKS).max() < 0.15  # the optimum's map of 40 scans with sigmas of 0.1
