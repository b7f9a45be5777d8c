"""Recordings as graphs in g2o's text form, as `g2o` reads them: the same recording, but for its time stamps.

Landmarks keep their ids, and poses have ids of their own: 0 to N, or from the largest landmark's on where these meet.
Vertices are a first guess: dead reckoning, and each landmark where it was first seen from there (one of bearings alone
at a metre's distance). A start without noise is FIX, any other EDGE_PRIOR_SE2; it is the last line, since GTSAM reads
no edge behind it. Ranges with bearings have no edge of g2o's own: they are BR, which GTSAM reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.back_projection import positions_seen
from slamgauge.compare.storage.covariance_columns import upper_triangles
from slamgauge.compare.storage.files import explained
from slamgauge.covariances import inverted, scale_of
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation

EDGES = {"position": "EDGE_SE2_XY", "bearing": "EDGE_BEARING_SE2_XY"}  # of sensors; ranges with bearings are BR


def write_g2o(path: Path, recording: Recording, *, lend: float | None = None) -> None:
    """Write a recording as a graph.

    Args:
        path: The file.
        recording: With known association.
        lend: Standard deviation [m, rad] that is added to every direction of motions, and of a start, whose covariance
            is singular: a graph has no information matrix for those. None refuses them.

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
    lines = [
        *_written("VERTEX_SE2", poses[:, None], path_guess),
        *_written("VERTEX_XY", ids[:, None], positions_seen(recording, first, path_guess)),
        *_motions(recording, poses, lend),
        *_sights(recording, poses, recording.landmark),
        *_start(recording, int(poses[0]), lend),
    ]
    with explained(path, "written"):
        path.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")


def _start(recording: Recording, first_pose: int, lend: float | None) -> Iterator[str]:
    """What is known of the first pose."""
    if not recording.prior_cov.any():
        return iter([f"FIX {first_pose}"])
    prior = _regular(recording.prior_cov[None], "prior_cov", lend)
    turn = np.eye(3)
    turn[:2, :2] = rotation(recording.prior_mean[2])
    information = upper_triangles(inverted(turn.T @ prior @ turn))
    numbers = np.column_stack([recording.prior_mean[None], information])
    return _written("EDGE_PRIOR_SE2", np.array([[first_pose]]), numbers)


def _motions(recording: Recording, poses: Int, lend: float | None) -> Iterator[str]:
    information = inverted(_regular(recording.odometry_cov, "odometry_cov", lend))
    numbers = np.column_stack([recording.odometry, upper_triangles(information)])
    return _written("EDGE_SE2", np.column_stack([poses[:-1], poses[1:]]), numbers)


def _sights(recording: Recording, poses: Int, landmark: Int) -> Iterator[str]:
    ids = np.column_stack([poses[recording.observation_step], landmark])
    values, covs = recording.observation, recording.observation_cov
    if recording.sensor in EDGES:
        return _written(EDGES[recording.sensor], ids, np.column_stack([values, upper_triangles(inverted(covs))]))
    if covs[:, 0, 1].any():
        row = int(np.argmax(covs[:, 0, 1] != 0.0))
        what = f"observation_cov[{row}]: range and bearing are correlated, for which graphs have no edge"
        raise UserError(f"{what}; export the recording as csv or mat")
    sigmas = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    return _written("BR", ids, np.column_stack([values[:, ::-1], sigmas[:, ::-1]]))


def _regular(covs: Float, name: str, lend: float | None) -> Float:
    """Covariances (n, 3, 3) that have inverses."""
    singular = _are_singular(covs)
    if not singular.any():
        return covs
    if lend is None:
        what = f"{name}[{int(np.argmax(singular))}]: is singular, and a graph's information matrix its inverse"
        raise UserError(f"{what}; lend such motions a small sigma, for example --lend 1e-4, or export as csv or mat")
    covs = covs + lend**2 * singular[:, None, None] * np.eye(3)
    if (still := _are_singular(covs)).any():
        raise UserError(f"{name}[{int(np.argmax(still))}]: is singular with {lend:g} lent, too; lend more")
    return covs


def _are_singular(covs: Float) -> Marks:
    """Which covariances (n, 3, 3) have no inverse that is worth its digits."""
    without = (np.diagonal(covs, axis1=1, axis2=2) <= 0.0).any(axis=1)
    return without | (np.linalg.eigvalsh(covs / scale_of(covs))[:, 0] <= 1e-12)


def _written(tag: str, ids: Int, numbers: Float) -> Iterator[str]:
    """Lines of a tag, ids (n, k) and numbers (n, m) in full precision."""
    for names, row in zip(ids.tolist(), numbers.tolist(), strict=True):
        yield " ".join([tag, *map(str, names), *map(repr, row)])
