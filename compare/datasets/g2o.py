"""Pose graphs with landmarks in the text form of g2o, with the tags of g2o, TORO, GTSAM and iSAM.

`FORMS` has their lines: i and j are poses, l is a landmark. VERTEX_... is a first guess. An edge is pose j, landmark l
or its bearing in the frame of pose i. FIX i names poses that are known exactly. I are entries of the information
matrix, c of the covariance; EDGE2 has TORO's order of entries. Sources: g2o's wiki (File Format SLAM 2D), TORO's
README, GTSAM's dataset.cpp for BR and for the endings of ODOMETRY and LANDMARK. iSAM ends these two and EDGE2 with the
square root of the information, R of R'R.

In g2o and GTSAM the error of an edge is the pose z^-1 x_i^-1 x_j, and its matrix weighs that in the frame of the pose
to which z leads. Our optima do the same, so that `batch` of a recording has the cost of its graph. Filters take the
matrix in the frame of pose i, which differs by the turn of one step. A prior is of z^-1 x_i, and turned to the world's
frame.

Vertices are a first guess, not a truth. The start is that of EDGE_PRIOR_SE2; else the vertex, and fixed; else the
origin. Graphs have no time stamps: step k is at k seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.imported_log import (
    Imported,
    checked,
    of_file,
    require_rows,
    with_sigmas,
)
from slamgauge.compare.datasets.pose_chain import path_along, reversed_where
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import Line, read_tagged
from slamgauge.covariances import inverted, scale_of
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, chain, compose, pose_rotation
from slamgauge.sensors import Sensor

FORMS = {
    "VERTEX_SE2": "VERTEX_SE2 i x y theta",
    "VERTEX2": "VERTEX2 i x y theta",
    "VERTEX_XY": "VERTEX_XY l x y",
    "EDGE_PRIOR_SE2": "EDGE_PRIOR_SE2 i x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE_SE2": "EDGE_SE2 i j x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE2": "EDGE2 i j x y theta Ixx Ixy Iyy Itt Ixt Iyt",
    "ODOMETRY": "ODOMETRY i j x y theta cxx cxy cxt cyy cyt ctt",
    "EDGE_SE2_XY": "EDGE_SE2_XY i l x y Ixx Ixy Iyy",
    "LANDMARK": "LANDMARK i l x y cxx cxy cyy",
    "EDGE_BEARING_SE2_XY": "EDGE_BEARING_SE2_XY i l bearing I",
    "BR": "BR i l bearing range bearing-sigma range-sigma",
}
POSES, PRIOR = ("VERTEX_SE2", "VERTEX2"), "EDGE_PRIOR_SE2"
MOTIONS = ("EDGE_SE2", "EDGE2", "ODOMETRY")
SENSED: dict[str, Sensor] = {
    "EDGE_SE2_XY": "position",
    "LANDMARK": "position",
    "EDGE_BEARING_SE2_XY": "bearing",
    "BR": "range-bearing",
}
RAW = ("ROBOTLASER1", "PARAMS_SE2OFFSET")  # in g2o's files and not used: laser scans, the place of another sensor
UNSUPPORTED = {
    **dict.fromkeys(("EDGE_RANGE_SE2_XY", "EDGE_SE2_XY_RANGE", "EDGE_SE2_POINT_RANGE"), "a range-only edge"),
    **dict.fromkeys(("EDGE_PRIOR_XY", "EDGE_PRIOR_SE2_XY", "EDGE_XY_PRIOR"), "a prior of a landmark or a position"),
    **dict.fromkeys(("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "VERTEX3", "EDGE3", "VERTEX_TRACKXYZ"), "a graph in space"),
}
TORO_ORDER = np.array([0, 1, 4, 2, 5, 3])  # places of xx xy xt yy yt tt in TORO's order
REMEDY = "give every quantity a finite variance > 0, in the order of entries that its tag has"
KEY_BITS = 56  # bits of the number behind the letter in a key of GTSAM
PLAIN = "\0"  # letter of a key that is a number only

Lines = dict[str, list[Line]]


def read_g2o(path: Path, *, drop_loop_edges: bool = False, isam: bool = False) -> Imported:
    """Read the recording of a graph whose poses are one path.

    Args:
        path: The graph.
        drop_loop_edges: Whether edges between poses that are not on the path are dropped; else they are refused.
        isam: Whether EDGE2, ODOMETRY and LANDMARK end with the square root of the information, as in iSAM.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    lines = read_tagged(path, FORMS | dict.fromkeys(("FIX", *RAW), ""), UNSUPPORTED)
    notes = _renumber(lines)
    for line in _of(lines, FORMS):
        line.numbers(1)
    motions, seen = _of(lines, MOTIONS), _of(lines, SENSED)
    for what, tags, found in (("edge between poses", MOTIONS, motions), ("observation of a landmark", SENSED, seen)):
        if not found:
            raise UserError(f"{path}: no {what} in it; give a graph with {', '.join(tags)}")
    known = _known(lines)
    ids = np.array([[line.id_at(1), line.id_at(2)] for line in motions], dtype=np.int64)
    poses, edges = path_along(motions, ids, known if lines[PRIOR] else None, drop_others=drop_loop_edges)
    numbers = np.array([line.numbers(3) for line in motions])
    covs = _covariances(motions, numbers[:, 3:], 3, isam=isam)
    increments, covs = reversed_where(ids[edges, 0] != poses[:-1], numbers[edges, :3], covs[edges])
    step_of = {pose: step for step, pose in enumerate(poses)}
    vertices: dict[int, Line] = {}
    for line in _of(lines, POSES):
        if vertices.setdefault(line.id_at(1), line) is not line:
            raise line.refused(f"vertex {line.words[1]} was there before", "give every vertex one line")
    for line in (*vertices.values(), *lines["FIX"], *lines[PRIOR], *seen):
        if line.id_at(1) not in step_of:
            raise line.refused(f"pose {line.words[1]} is on no edge of the path", "correct the id, or join the pose")
        if line.words[0] in ("EDGE_SE2_XY", "EDGE_BEARING_SE2_XY") and line.id_at(2) in vertices:
            raise line.refused(f"vertex {line.words[2]} is a pose, not a landmark", "correct the id")
    if lines[PRIOR] and known != poses[0]:
        what = f"pose {known} is known, but the path begins at {poses[0]}"
        raise lines[PRIOR][0].refused(what, "give that one the prior")
    if lines[PRIOR] and not lines["FIX"]:
        (prior,) = np.array([lines[PRIOR][0].numbers(2)])
        turn = pose_rotation(prior[2])
        prior_cov = turn @ _covariances(lines[PRIOR], prior[None, 3:], 3)[0] @ turn.T
        prior_mean = prior[:3]
    else:
        fixed = poses[0] if known is None else known
        vertex = np.array(vertices[fixed].numbers(2)) if fixed in vertices else np.zeros(3)
        reached = chain(np.zeros(3), increments[: step_of[fixed]])[-1]
        prior_mean, prior_cov = compose(vertex, between(reached, np.zeros(3))), np.zeros((3, 3))
        if fixed != poses[0]:
            notes.append(f"pose {fixed} in mid-path is fixed: the start is placed so that dead reckoning reaches it")
    if len(edges) < len(motions):
        notes.append(f"{len(motions) - len(edges)} edges between poses that are not on the path are dropped")
    notes += [f"{len(lines[tag])} lines {tag} are not used" for tag in RAW if lines[tag]]
    sensor, values, observation_covs = _measured(seen, isam=isam)
    steps = np.array([step_of[line.id_at(1)] for line in seen], dtype=np.int64)
    landmark = np.array([line.id_at(2) for line in seen], dtype=np.int64)
    order = np.argsort(steps, kind="stable")
    with of_file(path):
        recording = Recording(
            stamps=np.arange(len(poses), dtype=np.float64),
            prior_mean=prior_mean,
            prior_cov=prior_cov,
            odometry=increments,
            odometry_cov=covs,
            sensor=sensor,
            observation_step=steps[order],
            observation=values[order],
            observation_cov=observation_covs[order],
            landmark=landmark[order],
        )
    return Imported(recording, notes=tuple(notes))


def read_victoria_park(path: str | Path, *, max_range: float = math.inf) -> Recording:
    """Read the Victoria Park recording (ACFR, Sydney) in the text form that GTSAM distributes.

    It is a graph of lines ODOMETRY and LANDMARK: `position` sensor, association known, step k at k seconds. The first
    pose is the origin and fixed. The ids of poses increase along the path; some ids between are landmarks.

    Args:
        path: The text file.
        max_range: Observations of landmarks beyond this range [m] are dropped.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    reached: int | None = None
    for line in read_tagged(Path(path), {tag: FORMS[tag] for tag in ("ODOMETRY", "LANDMARK")})["ODOMETRY"]:
        start, end = line.id_at(1), line.id_at(2)
        if end <= start or reached not in (None, start):
            raise line.refused(f"leads from pose {start} to {end}, after pose {reached}", "sort the edges by ids")
        reached = end
    recording = read_g2o(Path(path)).recording
    return recording.only(np.hypot(*recording.observation.T) <= max_range)


def _of(lines: Lines, tags: Iterable[str]) -> list[Line]:
    """Return the lines of these tags in the order of the file."""
    return sorted((line for tag in tags for line in lines[tag]), key=lambda line: line.number)


def _renumber(lines: Lines) -> list[str]:
    """Replace the keys of GTSAM by small ids, in place; return a note about them.

    A key has the letter of its symbol in the highest of eight bytes, as in x12 or l3. The letter of the poses keeps its
    numbers. The numbers of other letters follow after a power of ten: with 300 poses, landmark l7 has the id 1007.
    """
    places = [(line, at) for line in _of(lines, (*MOTIONS, *SENSED)) for at in (1, 2)]
    places += [(line, 1) for line in _of(lines, (*POSES, "VERTEX_XY", PRIOR))]
    places += [(line, at) for line in lines["FIX"] for at in range(1, len(line.words))]
    keys = {word: int(word) for line, at in places if (word := line.words[at]).isdecimal() and len(word) < 20}
    symbols = {word: (chr(key >> KEY_BITS), key & ((1 << KEY_BITS) - 1)) for word, key in keys.items()}
    letters = list(dict.fromkeys(letter for letter, _ in symbols.values()))
    if letters in ([], [PLAIN]) or not all(letter == PLAIN or letter.isalpha() for letter in letters):
        return []
    apart = 10 ** len(str(max(number for _, number in symbols.values())))
    for line, at in places:
        if line.words[at] in symbols:
            letter, number = symbols[line.words[at]]
            line.words[at] = str(letters.index(letter) * apart + number)
    named = (f"{letter}1 has the id {apart * at + 1}" for at, letter in enumerate(letters) if letter != PLAIN)
    return [f"ids are keys of GTSAM and are renumbered: {', '.join(named)}"]


def _known(lines: Lines) -> int | None:
    """Return the pose that is fixed or has a prior; None without such a pose."""
    for line in lines["FIX"]:
        if len(line.words) == 1:
            raise line.refused("fixes nothing", "write FIX i")
    found = [(line.id_at(at), line) for line in lines["FIX"] for at in range(1, len(line.words))]
    landmarks = {line.id_at(1) for line in lines["VERTEX_XY"]}
    for name, line in found:
        if name in landmarks:
            raise line.refused(f"landmark {name} is fixed, which is not supported", "remove the line, and fix a pose")
    found += [(line.id_at(1), line) for line in lines[PRIOR]]
    if len({pose for pose, _ in found}) > 1 or len(lines[PRIOR]) > 1:
        raise found[-1][1].refused("more poses than the start are fixed or have a prior", "fix one pose, the first")
    return found[0][0] if found else None


def _measured(lines: list[Line], *, isam: bool) -> tuple[Sensor, Float, Float]:
    """Return the sensor, the same for all lines, values (M, d) and covariances (M, d, d)."""
    sensor = SENSED[lines[0].words[0]]
    for line in lines:
        if SENSED[line.words[0]] != sensor:
            what = f"a sensor of kind {SENSED[line.words[0]]}, and others of kind {sensor}"
            raise line.refused(what, "keep the edges of one kind")
    numbers = np.array([line.numbers(3) for line in lines])
    if sensor == "range-bearing":
        sigmas = numbers[:, [3, 2]]
        require_rows(lines, sigmas.min(axis=1) <= 0.0, "a sigma is not > 0", "correct it")
        return (
            sensor,
            checked(sensor, lines, numbers[:, [1, 0]]),
            with_sigmas(np.zeros((len(lines), 2, 2)), [*sigmas.T]),
        )
    dim = 2 if sensor == "position" else 1
    covs = _covariances(lines, numbers[:, dim:], dim, isam=isam)
    return sensor, checked(sensor, lines, numbers[:, :dim]), covs


def _covariances(lines: list[Line], entries: Float, size: int, *, isam: bool = False) -> Float:
    """Return covariances (n, size, size) of the entries (n, k) that end edges; a motion may have a singular one."""
    tags = np.array([line.words[0] for line in lines])
    of_toro = tags == "EDGE2"
    if of_toro.any() and not isam:
        entries = np.where(of_toro[:, None], entries[:, TORO_ORDER], entries)
    matrices, has_cov = from_triangles(entries, size), np.isin(tags, ("ODOMETRY", "LANDMARK"))
    if isam:
        roots = np.triu(matrices)
        matrices = np.where((has_cov | of_toro)[:, None, None], roots.swapaxes(1, 2) @ roots, matrices)
        has_cov[:] = False
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    smallest = np.linalg.eigvalsh(matrices / scale_of(matrices))[:, 0]
    may_be_singular = has_cov & (size == 3)
    wrong = np.where(may_be_singular, smallest < -1e-9, (variances <= 0.0).any(axis=1) | (smallest <= 1e-12))
    for kind, what in ((has_cov, "the covariance"), (~has_cov, "the information matrix")):
        require_rows(lines, wrong & kind, f"{what} is not positive definite", REMEDY)
    matrices[~has_cov] = inverted(matrices[~has_cov])
    return matrices
