"""Logs of the SLAM course at Freiburg (Stachniss, Robot Mapping): `sensor_data.dat`, with `world.dat` beside it.

    ODOMETRY r1 t r2           a step: turn by r1 [rad], go t [m] ahead, turn by r2 [rad]
    SENSOR id range bearing    what is seen after it [m, rad]

`world.dat` has a line `id x y` for every landmark, which becomes the truth; without it there is none. The robot starts
at the world's origin. The log has no time stamps: step k is at k seconds. Its noise is not in the file. The defaults
suit simulated logs: sigmas of 0.005 rad, 0.01 m and 0.005 rad for the three parts of a step, and 0.1 m and 0.1 rad for
range and bearing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, of_file, require_sigmas
from slamgauge.compare.datasets.text_lines import Line, read_lines, read_table
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import wrap
from slamgauge.truth import Truth

LOG, WORLD = "sensor_data.dat", "world.dat"
FORMS = {"ODOMETRY": "ODOMETRY r1 t r2", "SENSOR": "SENSOR id range bearing"}


def read_freiburg(
    path: Path,
    *,
    rotation_sigma: float = 0.005,
    translation_sigma: float = 0.01,
    range_sigma: float = 0.1,
    bearing_sigma: float = 0.1,
) -> Imported:
    """The recording of a log of the course, `range-bearing` and with ids, and the landmarks of its world as truth.

    Args:
        path: The log, or the folder in which it is called sensor_data.dat.
        rotation_sigma: Standard deviation of each of a step's two turns [rad].
        translation_sigma: Standard deviation of a step's way [m].
        range_sigma: Standard deviation of ranges [m].
        bearing_sigma: Standard deviation of bearings [rad].

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_sigmas(rotation=rotation_sigma, translation=translation_sigma, range=range_sigma, bearing=bearing_sigma)
    path = path / LOG if path.is_dir() else path
    moves, seen, step_of = _read(path)
    motion = np.array([line.numbers(1) for line in moves])
    sights = np.array([line.numbers(2) for line in seen]).reshape(-1, 2)
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
            observation_step=np.array(step_of, dtype=np.int64),
            observation=np.column_stack([sights[:, 0], wrap(sights[:, 1])]),
            observation_cov=diagonal_covariances(np.tile([range_sigma, bearing_sigma], (len(seen), 1))),
            landmark=landmark,
        )
    return Imported(recording, _world(path.with_name(WORLD), seen), ())


def increments(motion: Float) -> Float:
    """Body-frame increments (n, 3) of steps r1, t, r2 (n, 3) [rad, m, rad]."""
    first, way, second = motion.T
    return np.column_stack([way * np.cos(first), way * np.sin(first), wrap(first + second)])


def increment_jacobians(motion: Float) -> Float:
    """Jacobians (n, 3, 3) of `increments` by r1, t and r2."""
    first, way, _ = motion.T
    jacobians = np.zeros((len(motion), 3, 3))
    jacobians[:, 0, 0], jacobians[:, 0, 1] = -way * np.sin(first), np.cos(first)
    jacobians[:, 1, 0], jacobians[:, 1, 1] = way * np.cos(first), np.sin(first)
    jacobians[:, 2, 0] = jacobians[:, 2, 2] = 1.0
    return jacobians


def _read(path: Path) -> tuple[list[Line], list[Line], list[int]]:
    """The ODOMETRY lines, the SENSOR lines, and the step of each of the latter."""
    found: dict[str, list[Line]] = {"ODOMETRY": [], "SENSOR": []}
    step_of = list[int]()
    for line in read_lines(path):
        tag = line.words[0]
        if tag not in FORMS:
            raise line.refused(f"{tag[:20]!r} is neither ODOMETRY nor SENSOR", "remove the line")
        line.require(FORMS[tag])
        if tag == "SENSOR":
            if line.number_at(2) < 0.0:
                raise line.refused(f"a range of {line.words[2][:40]} m", "remove the line")
            step_of.append(len(found["ODOMETRY"]))
        found[tag].append(line)
    if not found["ODOMETRY"]:
        raise UserError(f"{path}: no ODOMETRY line in it; give {LOG} of the course")
    return found["ODOMETRY"], found["SENSOR"], step_of


def _world(path: Path, seen: list[Line]) -> Truth | None:
    """The truth of world.dat, if there is one."""
    if not path.exists():
        return None
    lines, table = read_table(path, "id x y")
    ids = [line.id_at(0) for line in lines]
    known = set[int]()
    for line, name in zip(lines, ids, strict=True):
        if name in known:
            raise line.refused(f"landmark {name} was there before", "give every landmark one line")
        known.add(name)
    for line in seen:
        if line.id_at(1) not in known:
            raise line.refused(f"landmark {line.words[1]} is not in {path.name}", "add it there, or remove the line")
    association = np.array([line.id_at(1) for line in seen], dtype=np.int64)
    return Truth(landmark_ids=np.array(ids), landmarks=table[:, 1:], association=association)
