"""Small synthetic logs with the names and formats of the published logs that pages import."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import savemat

from slamgauge import Recording, Truth, load_scenario, simulate
from slamgauge.compare.datasets.g2o_writer import write_g2o
from tests.reference.random_recordings import recording_of
from tests.reference.robot_logs import G2O, MRCLAM

SHORT = ("trajectory.duration=6", "trajectory.step=0.1")


def write_published_logs(folder: Path) -> None:
    """Write `dataset2.mat`, `victoria_park.txt`, `graph.g2o` and `MRCLAM_Dataset1`."""
    truth, recording = simulate(load_scenario("q1-short-dense", SHORT), 1)
    savemat(folder / "dataset2.mat", lost_in_the_woods(truth, recording), do_compression=True)
    write_g2o(folder / "victoria_park.txt", recording_of("position"))
    (folder / "graph.g2o").write_text(G2O["graph.g2o"])
    (folder / "MRCLAM_Dataset1").mkdir()
    for file, text in MRCLAM.items():
        (folder / "MRCLAM_Dataset1" / file.replace("Robot2", "Robot1")).write_text(text)


def lost_in_the_woods(truth: Truth, recording: Recording) -> dict[str, object]:
    """Return the variables of the MATLAB file: a row per step, a column per landmark, 0 m without an observation."""
    assert truth.poses is not None and truth.landmarks is not None and recording.landmark is not None
    steps = recording.steps
    ranges, bearings = np.zeros((2, steps, len(truth.landmarks)))
    seen = recording.observation_step < steps
    at = recording.observation_step[seen], recording.landmark[seen]
    ranges[at], bearings[at] = recording.observation[seen].T
    x, y, heading = truth.poses[:-1].T[:, :, None]
    return {
        "t": 0.1 * np.arange(steps)[:, None],
        "v": recording.odometry[:, :1] / 0.1,
        "om": recording.odometry[:, 2:] / 0.1,
        "d": 0.0,
        "x_true": x,
        "y_true": y,
        "th_true": heading,
        "true_valid": np.ones((steps, 1), dtype=np.uint8),
        "r": ranges,
        "b": bearings,
        "l": truth.landmarks,
        "r_var": 0.01,
        "b_var": 0.001,
        "v_var": 0.01,
        "om_var": 0.01,
    }
