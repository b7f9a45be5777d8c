"""Write recordings as graphs in g2o's text form. `g2o` reads them back: the same recording, except its time stamps.

Landmarks keep their ids. Poses have the ids 0 to N or, if a landmark has one of these, ids after the last landmark's.
Vertices are a first guess: dead reckoning, and each landmark at its first observation from there (a bearing-only one at
1 m). A start without noise is FIX, any other EDGE_PRIOR_SE2. It is the last line, since GTSAM reads no edge behind it.
g2o has no edge for range and bearing; they are BR, which GTSAM reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.g2o import SINGULAR, smallest_eigenvalues
from slamgauge.compare.storage.csv_folder import upper_triangles
from slamgauge.compare.storage.files import explained
from slamgauge.covariances import inverted
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain, pose_rotation

EDGES = {"position": "EDGE_SE2_XY", "bearing": "EDGE_BEARING_SE2_XY"}  # tags; range and bearing are BR


def write_g2o(path: Path, recording: Recording, *, lend: float | None = None) -> None:
    """Write a recording as a graph.

    Args:
        path: The file.
        recording: With known association.
        lend: Standard deviation [m, rad] of the regularising noise for motions and a start with a singular covariance.
            None refuses them: a graph has no information matrix for them.

    Raises:
        UserError: the file cannot be written, or the recording has no such graph.
    """
    if recording.landmark is None:
        raise UserError("landmark: a graph needs ids, and this recording has none; export it as csv or mat")
    ids, first = np.unique(recording.landmark, return_index=True)
    last = int(ids.max(initial=-1))
    first_pose = last + 1 if ids.min(initial=last + 1) <= recording.steps else 0
    poses = np.arange(first_pose, first_pose + recording.steps + 1)
    path_guess = chain(recording.prior_mean, recording.odometry)
    information = upper_triangles(inverted(_regular(recording.odometry_cov, "odometry_cov", lend)))
    motions = np.column_stack([recording.odometry, information])
    seen = np.column_stack([poses[recording.observation_step], recording.landmark])
    lines = [
        *_written("VERTEX_SE2", poses[:, None], path_guess),
        *_written("VERTEX_XY", ids[:, None], recording.positions_seen(first, path_guess)),
        *_written("EDGE_SE2", np.column_stack([poses[:-1], poses[1:]]), motions),
        *_written(EDGES.get(recording.sensor, "BR"), seen, _observations(recording)),
    ]
    if recording.prior_cov.any():
        prior, turn = _regular(recording.prior_cov[None], "prior_cov", lend), pose_rotation(recording.prior_mean[2])
        triangle = upper_triangles(inverted(turn.T @ prior @ turn))
        lines += _written("EDGE_PRIOR_SE2", poses[:1, None], np.column_stack([recording.prior_mean[None], triangle]))
    else:
        lines.append(f"FIX {first_pose}")
    with explained(path, "written"):
        path.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")


def _observations(recording: Recording) -> Float:
    """Return the numbers (M, k) that end the lines of observations."""
    values, covs = recording.observation, recording.observation_cov
    if recording.sensor in EDGES:
        return np.column_stack([values, upper_triangles(inverted(covs))])
    if covs[:, 0, 1].any():
        row = int(np.argmax(covs[:, 0, 1] != 0.0))
        what = f"observation_cov[{row}]: range and bearing are correlated, and graphs have no edge for that"
        raise UserError(f"{what}; export the recording as csv or mat")
    return np.column_stack([values[:, ::-1], np.sqrt(np.diagonal(covs, axis1=1, axis2=2))[:, ::-1]])


def _regular(covs: Float, name: str, lend: float | None) -> Float:
    """Return covariances (n, 3, 3) that have inverses, with regularising noise `lend` where that is needed."""
    if lend is not None:
        covs = covs + lend**2 * (smallest_eigenvalues(covs) <= SINGULAR)[:, None, None] * np.eye(3)
    singular = smallest_eigenvalues(covs) <= SINGULAR
    if singular.any():
        what = f"{name}[{int(np.argmax(singular))}]: is singular, but a graph needs its inverse"
        remedy = "add regularising noise, for example --lend 1e-4, or a larger one, or export as csv or mat"
        raise UserError(f"{what}; {remedy}")
    return covs


def _written(tag: str, ids: Int, numbers: Float) -> Iterator[str]:
    """Yield lines of a tag, ids (n, k) and numbers (n, m) in full precision."""
    for names, row in zip(ids.tolist(), numbers.tolist(), strict=True):
        yield " ".join([tag, *map(str, names), *map(repr, row)])
