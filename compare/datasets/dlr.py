"""The landmark log of the DLR Spatial Cognition data set (Kurlbaum and Frese 2009), and logs of its form.

    STEP image dX dY dphi cXX cXY cYY cXphi cYphi cphiphi    the movement before the image, and its covariance
    LANDMARK X Y quality cXX cXY cYY id                      a landmark in the image after the STEP above

Metres and radians in the frame of the robot, whose forward is -Y. Here forward is x: everything is turned by a quarter,
(x, y) = (-Y, X), covariances too; angles stay. (The file's description has X to the robot's right: with angles
counted from X to Y, as its numbers are, its map is then a mirror image of the place, before and after the turn.)

Also `LANDMARK_C`, as a later edition of the log says. An id of -1 is none. The log has no time stamps: step k is at k
seconds. The start is the origin, and fixed; there is no ground truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import Imported, identified, of_file, require_covariances
from slamgauge.compare.datasets.text_lines import Line, read_lines
from slamgauge.errors import UserError
from slamgauge.recording import Recording

STEP = "STEP image dX dY dphi cXX cXY cYY cXphi cYphi cphiphi"
LANDMARK = "LANDMARK X Y quality cXX cXY cYY id"
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # (X, Y, phi) to (x, y, heading)


def read_dlr(path: Path, *, with_ids: bool = True) -> Imported:
    """The recording of a DLR landmark log: `position` sensor.

    Observations without an id are left out where others have one.

    Args:
        path: The log.
        with_ids: Whether ids are believed; without them all observations are kept and association is unknown.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    moves, seen, step_of = _read(path)
    motion = np.array([line.numbers(2) for line in moves])
    sights = np.array([line.numbers(1) for line in seen]).reshape(-1, 7)
    odometry_cov = _matrices(motion[:, 3:], ((0, 1, 3), (1, 2, 4), (3, 4, 5)))
    observation_cov = _matrices(sights[:, 3:6], ((0, 1), (1, 2)))
    remedy = "correct its numbers"
    require_covariances(moves, odometry_cov, "the covariance of the STEP", remedy, definite=False)
    require_covariances(seen, observation_cov, "the covariance of the LANDMARK", remedy)
    ids = np.array([line.id_at(7, least=-1) if with_ids else -1 for line in seen], dtype=np.int64)
    landmark, kept, notes = identified(ids)
    turn = QUARTER[:2, :2]
    with of_file(path):
        recording = Recording(
            stamps=np.arange(len(moves) + 1, dtype=np.float64),
            prior_mean=np.zeros(3),
            prior_cov=np.zeros((3, 3)),
            odometry=motion[:, :3] @ QUARTER.T,
            odometry_cov=QUARTER @ odometry_cov @ QUARTER.T,
            sensor="position",
            observation_step=np.array(step_of, dtype=np.int64)[kept],
            observation=sights[kept, :2] @ turn.T,
            observation_cov=turn @ observation_cov[kept] @ turn.T,
            landmark=landmark,
        )
    return Imported(recording, None, notes)


def _read(path: Path) -> tuple[list[Line], list[Line], list[int]]:
    """The STEP lines, the LANDMARK lines, and the step of each of the latter."""
    moves, seen, step_of = list[Line](), list[Line](), list[int]()
    for line in read_lines(path):
        match line.words[0]:
            case "STEP":
                line.require(STEP)
                moves.append(line)
            case "LANDMARK" | "LANDMARK_C":
                line.require(LANDMARK)
                seen.append(line)
                step_of.append(len(moves))
            case other:
                raise line.refused(f"{other[:20]!r} is neither STEP nor LANDMARK", "remove the line")
    if not moves:
        raise UserError(f"{path}: no STEP line in it; give a landmark log of the DLR data set")
    return moves, seen, step_of


def _matrices(entries: Float, places: tuple[tuple[int, ...], ...]) -> Float:
    """Matrices (n, d, d) whose entries are found among (n, d (d + 1) / 2) at these places."""
    return entries[:, np.array(places)]
