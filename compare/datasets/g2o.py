"""Pose graphs with landmarks in the text form of g2o, with the tags of g2o, TORO, GTSAM and iSAM.

`FORMS` has their lines: i and j are poses, l is a landmark. VERTEX_... is a first guess. An edge is pose j, landmark l
or its bearing in the frame of pose i. FIX i is a pose that is known exactly. I are entries of the information matrix, c
of the covariance; EDGE2 has TORO's order of entries. Sources: g2o's wiki (File Format SLAM 2D), TORO's README, GTSAM's
dataset.cpp for BR and for the endings of ODOMETRY and LANDMARK. iSAM ends these two and EDGE2 with the square root of
the information, R of R'R.

The error of an edge is the pose z^-1 x_i^-1 x_j in g2o, GTSAM and our optima, so that `batch` of a recording has the
cost of its graph. Filters take its matrix in the frame of pose i, which differs by the turn of one step. A prior is of
z^-1 x_i, and turned to the world's frame. The start is that of EDGE_PRIOR_SE2; else the vertex, and fixed; else the
origin. Graphs have no time stamps: step k is at k seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float, Marks
from slamgauge.compare.datasets import imported_log as logs
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import Line, read_tagged
from slamgauge.covariances import inverted, scale_of
from slamgauge.errors import UserError
from slamgauge.se2 import between, chain, compose, pose_rotation
from slamgauge.sensors import SENSORS, Sensor

FORMS = {
    "VERTEX_SE2": "VERTEX_SE2 i x y theta",
    "VERTEX2": "VERTEX2 i x y theta",
    "VERTEX_XY": "VERTEX_XY l x y",
    "FIX": "FIX i",
    "EDGE_PRIOR_SE2": "EDGE_PRIOR_SE2 i x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE_SE2": "EDGE_SE2 i j x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE2": "EDGE2 i j x y theta Ixx Ixy Iyy Itt Ixt Iyt",
    "ODOMETRY": "ODOMETRY i j x y theta cxx cxy cxt cyy cyt ctt",
    "EDGE_SE2_XY": "EDGE_SE2_XY i l x y Ixx Ixy Iyy",
    "LANDMARK": "LANDMARK i l x y cxx cxy cyy",
    "EDGE_BEARING_SE2_XY": "EDGE_BEARING_SE2_XY i l bearing I",
    "BR": "BR i l bearing range bearing-sigma range-sigma",
    **dict.fromkeys(("ROBOTLASER1", "PARAMS_SE2OFFSET"), ""),  # not used: laser scans, the place of another sensor
}
VERTICES, PRIOR = ("VERTEX_SE2", "VERTEX2"), "EDGE_PRIOR_SE2"
MOTIONS = ("EDGE_SE2", "EDGE2", "ODOMETRY")
SENSED: dict[str, Sensor] = {
    "EDGE_SE2_XY": "position",
    "LANDMARK": "position",
    "EDGE_BEARING_SE2_XY": "bearing",
    "BR": "range-bearing",
}
UNSUPPORTED = {  # parts of further tags, and what their lines are
    "RANGE": "a range-only edge",
    "PRIOR": "a prior of a landmark or a position",
    "XYZ": "a graph in space",
    "3": "a graph in space",
}
TORO_ORDER = np.array([0, 1, 4, 2, 5, 3])  # places of xx xy xt yy yt tt in TORO's order
SINGULAR = 1e-12  # smallest eigenvalue of correlations whose inverse has no correct digits

Lines = dict[str, list[Line]]


def read_g2o(path: Path, *, drop_loop_edges: bool = False, isam: bool = False) -> logs.Imported:
    """Read the recording of a graph whose poses are one path.

    Args:
        path: The graph.
        drop_loop_edges: Whether edges between poses that are not on the path are dropped; else they are refused.
        isam: Whether EDGE2, ODOMETRY and LANDMARK end with the square root of the information, as in iSAM.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    lines = read_tagged(path, FORMS, UNSUPPORTED)
    shortened = _shorten_keys(lines)
    motions, seen = _of(lines, MOTIONS), _of(lines, SENSED)
    for what, tags, found in (("edge between poses", MOTIONS, motions), ("observation of a landmark", SENSED, seen)):
        if not found:
            raise UserError(f"{path}: no {what} in it; give a graph with {', '.join(tags)}")
    known = _known(lines)
    poses, edges, backwards = _path_along(motions, known if lines[PRIOR] else None, drop_others=drop_loop_edges)
    step_of = {pose: step for step, pose in enumerate(poses)}
    _require_on_path(lines, step_of)
    numbers = np.array([motions[edge].numbers(3) for edge in edges])
    covs = _covariances([motions[edge] for edge in edges], numbers[:, 3:], isam=isam)
    increments, covs = _reversed(backwards, numbers[:, :3], covs)
    fixed = poses[0] if known is None else known
    if lines[PRIOR] and not lines["FIX"]:
        (prior,) = np.array([lines[PRIOR][0].numbers(2)])
        turn = pose_rotation(prior[2])
        prior_mean, prior_cov = prior[:3], turn @ _covariances(lines[PRIOR], prior[None, 3:])[0] @ turn.T
    else:
        vertices = {line.id_at(1): line.numbers(2) for line in _of(lines, VERTICES)}
        reached = chain(np.zeros(3), increments[: step_of[fixed]])[-1]
        prior_mean = compose(vertices.get(fixed, np.zeros(3)), between(reached, np.zeros(3)))
        prior_cov = np.zeros((3, 3))
    counts = {
        "edges between poses that are not on the path are dropped": len(motions) - len(edges),
        "laser scans (ROBOTLASER1) are left out": len(lines["ROBOTLASER1"]),
        "keys of GTSAM have short ids, the number and the code of the letter (l is 108): l7 is 7108": shortened,
    }
    notes = [f"{count} {what}" for what, count in counts.items() if count]
    if fixed != poses[0]:
        notes.append(f"pose {fixed} in mid-path is fixed: the start is placed so that dead reckoning reaches it")
    seen.sort(key=lambda line: step_of[line.id_at(1)])
    sensor, values, of_seen = _measured(seen, isam=isam)
    steps = np.array([step_of[line.id_at(1)] for line in seen], dtype=np.float64)
    log = logs.Log(
        where=path,
        odometry=logs.Odometry(np.arange(len(poses), dtype=np.float64), increments, covs),
        seen=logs.Observed(sensor, steps, [line.id_at(2) for line in seen], values, of_seen),
        has_steps=True,
        start=prior_mean.tolist(),
        prior_cov=prior_cov,
        notes=notes,
    )
    return log.imported()


def _of(lines: Lines, tags: Iterable[str]) -> list[Line]:
    """Return the lines of these tags in the order of the file."""
    return sorted((line for tag in tags for line in lines[tag]), key=lambda line: line.number)


def _shorten_keys(lines: Lines) -> int:
    """Replace the keys of GTSAM, with a letter in the highest of eight bytes, by small ids; return their number."""
    changed = set[str]()
    places = [(line, at) for line in _of(lines, (*MOTIONS, *SENSED)) for at in (1, 2)]
    places += [(line, 1) for line in _of(lines, (*VERTICES, "VERTEX_XY", "FIX", PRIOR))]
    for line, at in places:
        word = line.words[at]
        letter, number = divmod(int(word), 1 << 56) if word.isdecimal() and len(word) < 20 else (0, 0)
        if chr(letter).isalpha():
            line.words[at] = str(1000 * number + letter)
            changed.add(word)
    return len(changed)


def _known(lines: Lines) -> int | None:
    """Return the pose that is fixed or has a prior; None without such a pose."""
    found = [(line.id_at(1), line) for line in (*lines["FIX"], *lines[PRIOR])]
    poses = {line.id_at(at) for line in _of(lines, MOTIONS) for at in (1, 2)}
    landmarks = {*(line.id_at(1) for line in lines["VERTEX_XY"]), *(line.id_at(2) for line in _of(lines, SENSED))}
    for name, line in found:
        if name in landmarks - poses:
            raise line.refused(f"landmark {name} is fixed, which is not supported", "remove the line, and fix a pose")
        if name != found[0][0] or len(lines[PRIOR]) > 1:
            raise line.refused("more poses than the start are fixed or have a prior", "fix one pose, the first")
    return found[0][0] if found else None


def _path_along(lines: list[Line], start: int | None, *, drop_others: bool) -> tuple[list[int], list[int], Marks]:
    """Return the poses of the path along edges, its edges as indices, and which of them (n,) lead backwards.

    The path goes from id to id in increasing order, by the first edge between each two. All other edges close loops;
    they are refused or dropped.
    """
    ids = [(line.id_at(1), line.id_at(2)) for line in lines]
    joined: dict[int, dict[int, int]] = {}  # the first edge from each pose to each neighbour
    for edge, (i, j) in enumerate(ids):
        joined.setdefault(i, {}).setdefault(j, edge)
        joined.setdefault(j, {}).setdefault(i, edge)
    poses = sorted(joined)
    for i, j in pairwise(poses):
        if j not in joined[i]:
            remedy = "number the poses in the order of the path, and join each one to the next"
            raise lines[min(joined[j].values())].refused(f"no edge joins the poses {i} and {j}", remedy)
    path = [joined[i][j] for i, j in pairwise(poses)]
    others = sorted({*range(len(lines))} - {*path})
    if others and not drop_others:
        i, j = ids[others[0]]
        what = f"the edge between the poses {i} and {j} is not on the path; only landmarks may connect other poses"
        if joined[i][j] in path:
            what = f"a second edge between the poses {i} and {j}; merge both, weighted by their information"
        raise lines[others[0]].refused(what, "drop such edges with `import g2o --drop-loop-edges`")
    if start not in (None, poses[0]):
        raise UserError(f"{lines[0].path}: pose {start} has a prior, but the path begins at {poses[0]}; move the prior")
    return poses, path, np.array([ids[edge][0] != pose for edge, pose in zip(path, poses, strict=False)])


def _require_on_path(lines: Lines, step_of: dict[int, int]) -> None:
    """Refuse poses that are not on the path, and observations of poses."""
    for line in _of(lines, (*VERTICES, "FIX", PRIOR, *SENSED)):
        if line.id_at(1) not in step_of:
            raise line.refused(f"pose {line.words[1]} is on no edge of the path", "correct the id, or join the pose")
    vertices = {line.id_at(1) for line in _of(lines, VERTICES)}
    for line in _of(lines, ("EDGE_SE2_XY", "EDGE_BEARING_SE2_XY")):
        if line.id_at(2) in vertices:
            raise line.refused(f"vertex {line.words[2]} is a pose, not a landmark", "correct the id")


def _reversed(backwards: Marks, increments: Float, covs: Float) -> tuple[Float, Float]:
    """Reverse the increments (n, 3), with covariances (n, 3, 3), that are marked `backwards` (n,).

    The error of a reversed edge is -Ad(z) times what it was, z exp(v) = exp(Ad(z) v) z, and its cost is the same.
    """
    x, y, heading = increments[backwards].T
    adjoint = pose_rotation(heading)
    adjoint[:, 0, 2], adjoint[:, 1, 2] = y, -x
    covs[backwards] = adjoint @ covs[backwards] @ adjoint.swapaxes(1, 2)
    return np.where(backwards[:, None], between(increments, np.zeros(3)), increments), covs


def _measured(lines: list[Line], *, isam: bool) -> tuple[Sensor, Float, Float]:
    """Return the sensor, the same for all lines, values (M, d) and covariances (M, d, d)."""
    sensor = SENSED[lines[0].words[0]]
    for line in lines:
        if SENSED[line.words[0]] != sensor:
            what = f"a sensor of kind {SENSED[line.words[0]]}, and others of kind {sensor}"
            raise line.refused(what, "keep the edges of one kind")
    numbers = np.array([line.numbers(3) for line in lines])
    dim = SENSORS[sensor].dim
    if sensor != "range-bearing":
        covs = _covariances(lines, numbers[:, dim:], isam=isam)
        return sensor, logs.checked(sensor, lines, numbers[:, :dim]), covs
    bearings, ranges, *sigmas = numbers.T
    logs.require_rows(lines, np.min(sigmas, axis=0) <= 0.0, "a sigma is not > 0", "correct it")
    covs = logs.with_sigmas(np.zeros((len(lines), dim, dim)), sigmas[::-1])
    return sensor, logs.checked(sensor, lines, np.column_stack([ranges, bearings])), covs


def _covariances(lines: list[Line], entries: Float, *, isam: bool = False) -> Float:
    """Return covariances (n, d, d) of the entries (n, k) that end edges; `Recording` checks stated ones."""
    tags = np.array([line.words[0] for line in lines])
    of_toro = tags == "EDGE2"
    if of_toro.any() and not isam:
        entries = np.where(of_toro[:, None], entries[:, TORO_ORDER], entries)
    matrices, has_cov = from_triangles(entries), np.isin(tags, ("ODOMETRY", "LANDMARK"))
    if isam:
        roots = np.triu(matrices)
        matrices = np.where((has_cov | of_toro)[:, None, None], roots.swapaxes(1, 2) @ roots, matrices)
        has_cov[:] = False
    wrong = ~has_cov & (smallest_eigenvalues(matrices) <= SINGULAR)
    remedy = "give every quantity a finite variance > 0, in the order of entries that its tag has"
    logs.require_rows(lines, wrong, "the information matrix is not positive definite", remedy)
    matrices[~has_cov] = inverted(matrices[~has_cov])
    return matrices


def smallest_eigenvalues(matrices: Float) -> Float:
    """Return the smallest eigenvalues (n,) of correlations; 0 or less if a variance of the matrices (n, d, d) is 0."""
    return np.asarray(np.linalg.eigvalsh(matrices / scale_of(matrices))[:, 0], dtype=np.float64)
