"""The landmark log of the DLR Spatial Cognition data set (Kurlbaum and Frese 2009), and logs of its form.

    STEP image dX dY dphi cXX cXY cYY cXphi cYphi cphiphi    the movement before the image, and its covariance
    LANDMARK X Y quality cXX cXY cYY id                      a landmark in the image after the STEP above

Metres and radians in the frame of the robot, whose forward is -Y. Here forward is x: everything is turned by a quarter,
(x, y) = (-Y, X), covariances too; angles stay. (In the description of the file X points to the robot's right. With
angles counted from X to Y, as in its numbers, its map is then a mirror image of the place, before and after the turn.)

A later edition of the log writes `LANDMARK_C`. The id -1 means no id. The log has no time stamps: step k is at k
seconds. The start is the origin, and fixed. The log has no ground truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slamgauge.compare.datasets.imported_log import Imported, identified, of_file, require_covariances, steps_of
from slamgauge.compare.datasets.text_lines import read_tagged
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.errors import UserError
from slamgauge.recording import Recording

LANDMARKS = ("LANDMARK", "LANDMARK_C")
FORMS = {"STEP": "STEP image dX dY dphi cXX cXY cYY cXphi cYphi cphiphi"} | {
    tag: f"{tag} X Y quality cXX cXY cYY id" for tag in LANDMARKS
}
ROW_BY_ROW = [0, 1, 3, 2, 4, 5]  # places of cXX cXY cXphi cYY cYphi cphiphi in a STEP
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # (X, Y, phi) to (x, y, heading)


def read_dlr(path: Path, *, with_ids: bool = True) -> Imported:
    """Read a DLR landmark log: `position` sensor.

    If some observations have ids, those without are dropped.

    Args:
        path: The log.
        with_ids: Whether ids are used. If not, all observations are kept and association is unknown.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    lines = read_tagged(path, FORMS)
    moves = lines["STEP"]
    seen = sorted((line for tag in LANDMARKS for line in lines[tag]), key=lambda line: line.number)
    if not moves:
        raise UserError(f"{path}: no STEP line in it; give a landmark log of the DLR data set")
    motion = np.array([line.numbers(2) for line in moves])
    observed = np.array([line.numbers(1) for line in seen]).reshape(-1, 7)
    odometry_cov = from_triangles(motion[:, 3:][:, ROW_BY_ROW], 3)
    observation_cov = from_triangles(observed[:, 3:6], 2)
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
            observation_step=steps_of(moves, seen)[kept],
            observation=observed[kept, :2] @ turn.T,
            observation_cov=turn @ observation_cov[kept] @ turn.T,
            landmark=landmark,
        )
    return Imported(recording, notes=notes)
