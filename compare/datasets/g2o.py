"""Pose graphs with landmarks in the text form of g2o, with the tags of g2o, TORO, GTSAM and iSAM.

    VERTEX_SE2 i x y theta, VERTEX2 ...                           a pose: a first guess
    VERTEX_XY l x y                                               a landmark: a first guess
    FIX i ...                                                     poses that are known exactly
    EDGE_PRIOR_SE2 i x y theta  Ixx Ixy Ixt Iyy Iyt Itt           prior of a pose
    EDGE_SE2 i j x y theta      Ixx Ixy Ixt Iyy Iyt Itt           pose j in the frame of pose i
    EDGE2    i j x y theta      Ixx Ixy Iyy Itt Ixt Iyt           the same in TORO's order of entries
    ODOMETRY i j x y theta      cxx cxy cxt cyy cyt ctt           the same with a covariance
    EDGE_SE2_XY i l x y  Ixx Ixy Iyy     LANDMARK i l x y  cxx cxy cyy     landmark l in the frame of pose i
    EDGE_BEARING_SE2_XY i l bearing I                                      its bearing
    BR i l bearing range bearing-sigma range-sigma                         its bearing and range

I are entries of the information matrix, c of the covariance. Sources: g2o's wiki (File Format SLAM 2D), TORO's
README, GTSAM's dataset.cpp for BR and for the endings of ODOMETRY and LANDMARK. iSAM introduced these two tags and ends
them with the square root of the information, R of R'R.

In g2o and GTSAM the error of an edge is the pose z^-1 x_i^-1 x_j, and its matrix weighs that in the frame of the pose
to which z leads. Our optima do the same, so that `batch` of a recording has the cost of its graph. Filters take the
matrix in the frame of pose i, which differs by the turn of one step. A prior is of z^-1 x_i, and turned to the world's
frame.

Vertices are a first guess, not a truth. The start is that of EDGE_PRIOR_SE2; else the vertex, and fixed; else the
origin. Graphs have no time stamps: step k is at k seconds. `gtsam_keys` has the ids of graphs that GTSAM wrote.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.gtsam_keys import renumber
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, of_file, require_covariances
from slamgauge.compare.datasets.pose_chain import Edges, chained
from slamgauge.compare.datasets.row_checks import require_bearings
from slamgauge.compare.storage.csv_folder import from_triangles
from slamgauge.compare.storage.text_lines import Line, read_tagged
from slamgauge.covariances import inverted
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import between, compose, rotation, wrap
from slamgauge.se2 import chain as compose_chain
from slamgauge.sensors import Sensor

VERTICES = {"VERTEX_SE2": "VERTEX_SE2 i x y theta", "VERTEX2": "VERTEX2 i x y theta", "VERTEX_XY": "VERTEX_XY l x y"}
PRIOR = "EDGE_PRIOR_SE2"
MOTIONS = {
    "EDGE_SE2": "EDGE_SE2 i j x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE2": "EDGE2 i j x y theta Ixx Ixy Iyy Itt Ixt Iyt",
    "ODOMETRY": "ODOMETRY i j x y theta cxx cxy cxt cyy cyt ctt",
}
OBSERVATIONS = {
    "EDGE_SE2_XY": "EDGE_SE2_XY i l x y Ixx Ixy Iyy",
    "LANDMARK": "LANDMARK i l x y cxx cxy cyy",
    "EDGE_BEARING_SE2_XY": "EDGE_BEARING_SE2_XY i l bearing I",
    "BR": "BR i l bearing range bearing-sigma range-sigma",
}
FORMS = VERTICES | MOTIONS | OBSERVATIONS | {PRIOR: f"{PRIOR} i x y theta Ixx Ixy Ixt Iyy Iyt Itt"}
SENSORS: dict[str, Sensor] = {
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
    lines, notes = _read(path)
    sensor = _sensor(path, lines)
    chain = chained(_motions(lines, isam=isam), drop_loop_edges=drop_loop_edges, start=_start(lines))
    step_of = {pose: step for step, pose in enumerate(chain.poses)}
    for line in _of(lines, ("VERTEX_SE2", "VERTEX2")):
        if line.id_at(1) not in step_of:
            raise line.refused(f"pose {line.words[1]} is on no edge of the path", "join it, or remove the line")
    observed = _observations(lines, step_of)
    step = np.array([step_of[line.id_at(1)] for line in observed], dtype=np.int64)
    landmark = np.array([line.id_at(2) for line in observed], dtype=np.int64)
    values, covs = _measured(observed, np.array([line.numbers(3) for line in observed]), isam=isam)
    order = np.argsort(step, kind="stable")
    fixed = [line.id_at(1) for line in lines["FIX"]]
    prior_mean, prior_cov = _prior(lines, fixed[0] if fixed else chain.poses[0])
    if fixed and fixed[0] != chain.poses[0]:
        if fixed[0] not in step_of:
            raise lines["FIX"][0].refused(f"pose {fixed[0]} is on no edge of the path", "fix a pose of the path")
        reached = compose_chain(np.zeros(3), chain.increments[: step_of[fixed[0]]])[-1]
        prior_mean = compose(prior_mean, between(reached, np.zeros(3)))
        notes.append(f"pose {fixed[0]} in mid-path is fixed: the start is placed so that dead reckoning reaches it")
    notes += [f"{chain.dropped} edges between poses that are not on the path are dropped"] if chain.dropped else []
    ignored = len(_of(lines, RAW))
    notes += [f"{ignored} lines {' and '.join(tag for tag in RAW if lines[tag])} are not used"] if ignored else []
    with of_file(path):
        recording = Recording(
            stamps=np.arange(len(chain.poses), dtype=np.float64),
            prior_mean=prior_mean,
            prior_cov=prior_cov,
            odometry=chain.increments,
            odometry_cov=chain.covs,
            sensor=sensor,
            observation_step=step[order],
            observation=values[order],
            observation_cov=covs[order],
            landmark=landmark[order],
        )
    return Imported(recording, notes=tuple(notes))


def _read(path: Path) -> tuple[Lines, list[str]]:
    """Return the lines by their tags, and notes; GTSAM's keys are replaced.

    Repeated vertices, words that are not numbers and graphs without motions are refused.
    """
    lines = read_tagged(path, FORMS | dict.fromkeys(("FIX", *RAW), ""), UNSUPPORTED)
    pairs = [(line, at) for line in _of(lines, (*MOTIONS, *OBSERVATIONS)) for at in (1, 2)]
    notes = renumber(
        [
            *pairs,
            *((line, 1) for line in _of(lines, (*VERTICES, PRIOR))),
            *((line, at) for line in lines["FIX"] for at in range(1, len(line.words))),
        ]
    )
    for line in _of(lines, FORMS):
        line.numbers(1)
    for line in lines["FIX"]:
        if len(line.words) == 1:
            raise line.refused("fixes nothing", "write FIX i")
    for tags in (("VERTEX_SE2", "VERTEX2"), ("VERTEX_XY",)):
        met = set[int]()
        for line in _of(lines, tags):
            if line.id_at(1) in met:
                raise line.refused(f"vertex {line.words[1]} was there before", "give every vertex one line")
            met.add(line.id_at(1))
    if not _of(lines, MOTIONS):
        raise UserError(f"{path}: no edge between poses in it; give a graph with {', '.join(MOTIONS)}")
    return lines, [*notes]


def _of(lines: Lines, tags: Iterable[str]) -> list[Line]:
    """Return the lines of these tags, tag by tag."""
    return [line for tag in tags for line in lines[tag]]


def _sensor(path: Path, lines: Lines) -> Sensor:
    """Return the kind of sensor, the same for all observations."""
    tags = [tag for tag in OBSERVATIONS if lines[tag]]
    if not tags:
        raise UserError(f"{path}: it has no observation of a landmark; give a graph with {', '.join(OBSERVATIONS)}")
    sensor = SENSORS[tags[0]]
    for tag in tags:
        if SENSORS[tag] != sensor:
            what = f"a sensor of kind {SENSORS[tag]}, and others of kind {sensor}"
            raise lines[tag][0].refused(what, "keep the edges of one kind")
    return sensor


def _motions(lines: Lines, *, isam: bool) -> Edges:
    """Return the edges between poses in the order of the file, as increments with covariances."""
    found = sorted(_of(lines, MOTIONS), key=lambda line: line.number)
    ids = np.array([[line.id_at(1), line.id_at(2)] for line in found], dtype=np.int64)
    numbers = np.array([line.numbers(3) for line in found])
    increments, entries = numbers[:, :3], numbers[:, 3:]
    of_toro = [line.words[0] == "EDGE2" and not isam for line in found]
    entries[of_toro] = entries[of_toro][:, TORO_ORDER]
    return Edges(found, ids, increments, _covariances(found, entries, 3, isam=isam))


def _covariances(lines: list[Line], entries: Float, size: int, *, isam: bool) -> Float:
    """Return covariances (n, size, size) of the entries (n, k) that end edges.

    ODOMETRY and LANDMARK end with a covariance, or in iSAM with a square root of the information. A motion may have a
    singular covariance.
    """
    matrices = from_triangles(entries, size)
    stated = np.array([line.words[0] in ("ODOMETRY", "LANDMARK", *(["EDGE2"] if isam else [])) for line in lines])
    if isam:
        roots = np.triu(matrices[stated])
        matrices[stated] = roots.swapaxes(1, 2) @ roots
        stated[:] = False
    require_covariances(
        [lines[at] for at in np.flatnonzero(stated)], matrices[stated], "the covariance", REMEDY, definite=size == 2
    )
    matrices[~stated] = _inverse([lines[at] for at in np.flatnonzero(~stated)], matrices[~stated])
    return matrices


def _inverse(lines: list[Line], information: Float) -> Float:
    require_covariances(lines, information, "the information matrix", REMEDY)
    return inverted(information)


def _start(lines: Lines) -> tuple[int, Line] | None:
    """Return the pose that is fixed or has a prior, and its line; None without such a pose."""
    found = [(line.id_at(at), line) for line in lines["FIX"] for at in range(1, len(line.words))]
    landmarks = {line.id_at(1) for line in lines["VERTEX_XY"]}
    for name, line in found:
        if name in landmarks:
            raise line.refused(f"landmark {name} is fixed, which is not supported", "remove the line, and fix a pose")
    found += [(line.id_at(1), line) for line in lines[PRIOR]]
    poses = {pose for pose, _ in found}
    if len(poses) > 1 or len(lines[PRIOR]) > 1:
        raise found[-1][1].refused("more poses than the start are fixed or have a prior", "fix one pose, the first")
    return found[0] if lines[PRIOR] and found else None


def _prior(lines: Lines, first: int) -> tuple[Float, Float]:
    """Return mean (3,) and covariance (3, 3) of the first pose."""
    if lines[PRIOR] and not lines["FIX"]:
        numbers = np.array([lines[PRIOR][0].numbers(2)])
        turn = np.eye(3)
        turn[:2, :2] = rotation(numbers[0, 2])
        return numbers[0, :3], turn @ _inverse(lines[PRIOR], from_triangles(numbers[:, 3:], 3))[0] @ turn.T
    vertices = [line.numbers(2) for line in _of(lines, ("VERTEX_SE2", "VERTEX2")) if line.id_at(1) == first]
    return np.array(vertices[0]) if vertices else np.zeros(3), np.zeros((3, 3))


def _observations(lines: Lines, poses: Container[int]) -> list[Line]:
    """Return the observations in the order of the file; refuse poses that are not on the path."""
    found = sorted(_of(lines, OBSERVATIONS), key=lambda line: line.number)
    vertices = {line.id_at(1) for line in _of(lines, ("VERTEX_SE2", "VERTEX2"))}
    for line in found:
        if line.id_at(1) not in poses:
            raise line.refused(f"pose {line.words[1]} is not on the path", "correct the id")
        if line.words[0] in ("EDGE_SE2_XY", "EDGE_BEARING_SE2_XY") and line.id_at(2) in vertices:
            raise line.refused(f"vertex {line.words[2]} is a pose, not a landmark", "correct the id")
    return found


def _measured(lines: list[Line], numbers: Float, *, isam: bool) -> tuple[Float, Float]:
    """Return values (M, d) and covariances (M, d, d) of the numbers (M, k) that end the lines of one sensor."""
    match SENSORS[lines[0].words[0]]:
        case "position":
            return numbers[:, :2], _covariances(lines, numbers[:, 2:], 2, isam=isam)
        case "bearing":
            require_bearings(lines, numbers[:, 0])
            return wrap(numbers[:, :1]), _inverse(lines, numbers[:, 1:, None])
        case _:
            bearing, distance, *sigmas = numbers.T
            require_bearings(lines, bearing)
            if (wrong := (distance < 0.0) | (np.min(sigmas, axis=0) <= 0.0)).any():
                raise lines[int(np.argmax(wrong))].refused("a range < 0, or a sigma not > 0", "correct it")
            return np.column_stack([distance, wrap(bearing)]), diagonal_covariances(np.column_stack(sigmas[::-1]))
