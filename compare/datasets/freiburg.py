"""Logs of the SLAM course at Freiburg (Stachniss, Robot Mapping): `sensor_data.dat` and, in its folder, `world.dat`.

    ODOMETRY r1 t r2           a step: turn by r1 [rad], drive t [m] forward, turn by r2 [rad]
    SENSOR id range bearing    an observation after the step [m, rad]

`world.dat` has a line `id x y` for every landmark: the truth. The robot starts at the world's origin. The log has no
time stamps: step k is at k seconds. The file does not contain the noise. The defaults fit simulated logs.

The course simulates ranges with Gaussian noise, and near landmarks get ranges below 0. These observations are left out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.imported_log import (
    Imported,
    diagonal_covariances,
    of_file,
    require_sigmas,
    steps_of,
)
from slamgauge.compare.datasets.text_lines import Line, read_table, read_tagged
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import Truth

LOG, WORLD = "sensor_data.dat", "world.dat"
NAMED = 5  # number of left-out lines that the note names
FORMS = {"ODOMETRY": "ODOMETRY r1 t r2", "SENSOR": "SENSOR id range bearing"}


def read_freiburg(
    path: Path,
    *,
    rotation_sigma: float = 0.005,
    translation_sigma: float = 0.01,
    range_sigma: float = 0.1,
    bearing_sigma: float = 0.1,
) -> Imported:
    """Read a log of the course, `range-bearing` and with ids; the landmarks of its world are the truth.

    Observations with a range that is not positive are left out; a note counts them.

    Args:
        path: The log, or the folder in which it is called sensor_data.dat.
        rotation_sigma: Standard deviation of each of the two turns of a step [rad].
        translation_sigma: Standard deviation of the distance of a step [m].
        range_sigma: Standard deviation of ranges [m].
        bearing_sigma: Standard deviation of bearings [rad].

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_sigmas(rotation=rotation_sigma, translation=translation_sigma, range=range_sigma, bearing=bearing_sigma)
    path = path / LOG if path.is_dir() else path
    moves, seen = read_tagged(path, FORMS).values()
    if not moves:
        raise UserError(f"{path}: no ODOMETRY line in it; give {LOG} of the course")
    motion = np.array([line.numbers(1) for line in moves])
    seen, notes = _with_positive_ranges(seen)
    observed = np.array([line.numbers(2) for line in seen]).reshape(-1, 2)
    landmark = np.array([line.id_at(1) for line in seen], dtype=np.int64)
    jacobian = increment_jacobians(motion)
    variances = np.array([rotation_sigma, translation_sigma, rotation_sigma]) ** 2
    with of_file(path):
        recording = Recording(
            stamps=np.arange(len(moves) + 1, dtype=np.float64),
            prior_mean=np.zeros(3),
            prior_cov=np.zeros((3, 3)),
            odometry=increments(motion),
            odometry_cov=np.einsum("nij,j,nkj->nik", jacobian, variances, jacobian),
            sensor="range-bearing",
            observation_step=steps_of(moves, seen),
            observation=np.column_stack([observed[:, 0], wrap(observed[:, 1])]),
            observation_cov=diagonal_covariances(np.tile([range_sigma, bearing_sigma], (len(seen), 1))),
            landmark=landmark,
        )
    return Imported(recording, _world(path.with_name(WORLD), seen, landmark), notes)


def _with_positive_ranges(seen: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Return the observations with a range above 0 m, and a note on the others with their first lines."""
    kept = [line for line in seen if line.number_at(2) > 0.0]
    lost = [str(line.number) for line in seen if not line.number_at(2) > 0.0]
    if not lost:
        return kept, ()
    first = ", ".join(lost[:NAMED]) + (", ..." if len(lost) > NAMED else "")
    what = "1 observation with a range that is not positive was"
    if len(lost) > 1:
        what = f"{len(lost)} observations with a range that is not positive were"
    return kept, (f"{what} left out (line{'s' if len(lost) > 1 else ''} {first})",)


def increments(motion: Float) -> Float:
    """Return body-frame increments (n, 3) of steps r1, t, r2 (n, 3) [rad, m, rad]."""
    first, distance, second = motion.T
    return np.column_stack([distance * np.cos(first), distance * np.sin(first), wrap(first + second)])


def increment_jacobians(motion: Float) -> Float:
    """Return Jacobians (n, 3, 3) of `increments` by r1, t and r2."""
    first, distance, _ = motion.T
    jacobians = np.zeros((len(motion), 3, 3))
    jacobians[:, 0, 0], jacobians[:, 0, 1] = -distance * np.sin(first), np.cos(first)
    jacobians[:, 1, 0], jacobians[:, 1, 1] = distance * np.cos(first), np.sin(first)
    jacobians[:, 2, 0] = jacobians[:, 2, 2] = 1.0
    return jacobians


def _world(path: Path, seen: list[Line], landmark: Int) -> Truth | None:
    """Return the truth of world.dat, with the observed landmarks (M,), if the file exists."""
    if not path.exists():
        return None
    lines, table = read_table(path, "id x y")
    ids = np.array([line.id_at(0) for line in lines], dtype=np.int64)
    known = set[int]()
    for line, name in zip(lines, ids.tolist(), strict=True):
        if name in known:
            raise line.refused(f"landmark {name} was there before", "give every landmark one line")
        known.add(name)
    for line, name in zip(seen, landmark.tolist(), strict=True):
        if name not in known:
            raise line.refused(f"landmark {name} is not in {path.name}", "add it there, or remove the line")
    with of_file(path):
        return Truth(landmark_ids=ids, landmarks=table[:, 1:], association=landmark)
