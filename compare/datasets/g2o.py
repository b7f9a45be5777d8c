"""Pose graphs with landmarks in the text form of g2o, with the tags of TORO, GTSAM and iSAM beside its own.

    VERTEX_SE2 i x y theta, VERTEX2 ...                           a pose, as it is believed at the start
    VERTEX_XY l x y                                               a landmark, likewise
    FIX i ...                                                     poses that are known exactly
    EDGE_PRIOR_SE2 i x y theta  Ixx Ixy Ixt Iyy Iyt Itt           what is known of a pose
    EDGE_SE2 i j x y theta      Ixx Ixy Ixt Iyy Iyt Itt           pose j in the frame of pose i
    EDGE2    i j x y theta      Ixx Ixy Iyy Itt Ixt Iyt           the same in TORO's order of entries
    ODOMETRY i j x y theta      cxx cxy cxt cyy cyt ctt           the same with a covariance
    EDGE_SE2_XY i l x y  Ixx Ixy Iyy     LANDMARK i l x y  cxx cxy cyy     landmark l in the frame of pose i
    EDGE_BEARING_SE2_XY i l bearing I                                      its bearing
    BR i l bearing range bearing-sigma range-sigma                         its bearing and range

I are entries of the information matrix, c of the covariance. Sources: g2o's wiki (File Format SLAM 2D), TORO's
README, GTSAM's dataset.cpp for BR and for what ends ODOMETRY and LANDMARK; iSAM, whose tags these two are, ends them
with the square root of the information, R of R'R.

In g2o and GTSAM the error of an edge is the pose z^-1 x_i^-1 x_j, and its matrix weighs that in the frame of the pose
that z leads to. So do our optima, and `batch` of a recording has the cost of its graph; filters take the matrix in the
frame of pose i, which differs by the turn of one step. A prior is of z^-1 x_i, and turned to the world's frame.

Vertices are a first guess, and no truth. The start is that of EDGE_PRIOR_SE2; else the vertex, and fixed; else the
origin. Graphs have no time stamps: step k is at k seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.compare.datasets.imported_log import Imported, diagonal_covariances, of_file, require_covariances
from slamgauge.compare.datasets.pose_chain import Edges, chained
from slamgauge.compare.datasets.text_lines import Line, read_lines
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.covariances import inverted
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import rotation, wrap
from slamgauge.sensors import Sensor
from slamgauge.suggestions import did_you_mean

VERTICES = {"VERTEX_SE2": "VERTEX_SE2 i x y theta", "VERTEX2": "VERTEX2 i x y theta", "VERTEX_XY": "VERTEX_XY l x y"}
PRIOR = "EDGE_PRIOR_SE2"
MOTIONS = {
    "EDGE_SE2": "EDGE_SE2 i j x y theta Ixx Ixy Ixt Iyy Iyt Itt",
    "EDGE2": "EDGE2 i j x y theta Ixx Ixy Iyy Itt Ixt Iyt",
    "ODOMETRY": "ODOMETRY i j x y theta cxx cxy cxt cyy cyt ctt",
}
SIGHTS = {
    "EDGE_SE2_XY": "EDGE_SE2_XY i l x y Ixx Ixy Iyy",
    "LANDMARK": "LANDMARK i l x y cxx cxy cyy",
    "EDGE_BEARING_SE2_XY": "EDGE_BEARING_SE2_XY i l bearing I",
    "BR": "BR i l bearing range bearing-sigma range-sigma",
}
FORMS = VERTICES | MOTIONS | SIGHTS | {PRIOR: f"{PRIOR} i x y theta Ixx Ixy Ixt Iyy Iyt Itt"}
SENSORS: dict[str, Sensor] = {
    "EDGE_SE2_XY": "position",
    "LANDMARK": "position",
    "EDGE_BEARING_SE2_XY": "bearing",
    "BR": "range-bearing",
}
RAW = ("ROBOTLASER1", "PARAMS_SE2OFFSET")  # what g2o's files carry along: scans, and the place of an unused sensor
TORO_ORDER = np.array([0, 1, 4, 2, 5, 3])  # where TORO has xx xy xt yy yt tt
REMEDY = "give every quantity a finite variance > 0, in the order of entries that its tag has"

Lines = dict[str, list[Line]]


def read_g2o(path: Path, *, drop_loop_edges: bool = False, isam: bool = False) -> Imported:
    """The recording of a graph whose poses are one path.

    Args:
        path: The graph.
        drop_loop_edges: Whether edges between poses beside the path are left out; else they are refused.
        isam: Whether ODOMETRY and LANDMARK end with the square root of the information, as iSAM writes them.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    lines = _read(path)
    sensor = _sensor(path, lines)
    chain = chained(_motions(lines, isam=isam), drop_loop_edges=drop_loop_edges, start=_start(lines))
    step_of = {pose: step for step, pose in enumerate(chain.poses)}
    for line in _of(lines, ("VERTEX_SE2", "VERTEX2")):
        if line.id_at(1) not in step_of:
            raise line.refused(f"pose {line.words[1]} is on no edge of the path", "join it, or remove the line")
    sights = _sights(lines, step_of, isam=isam)
    order = np.argsort(sights.step, kind="stable")
    prior_mean, prior_cov = _prior(lines, chain.poses[0])
    notes = [f"{chain.dropped} edges between poses beside the path are left out"] if chain.dropped else []
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
            observation_step=sights.step[order],
            observation=sights.value[order],
            observation_cov=sights.cov[order],
            landmark=sights.landmark[order],
        )
    return Imported(recording, None, tuple(notes))


def _read(path: Path) -> Lines:
    """The lines by their tags, each with as many numbers as it must have."""
    known = (*FORMS, "FIX", *RAW)
    lines: Lines = {tag: [] for tag in known}
    for line in read_lines(path):
        tag = line.words[0]
        if tag not in lines:
            raise line.refused(f"{tag[:30]!r} is no tag of planar graphs", did_you_mean(tag[:30], known))
        if tag in FORMS:
            line.require(FORMS[tag])
            line.numbers(1)
        elif tag == "FIX" and len(line.words) == 1:
            raise line.refused("fixes nothing", "write FIX i")
        lines[tag].append(line)
    for tags in (("VERTEX_SE2", "VERTEX2"), ("VERTEX_XY",)):
        met = set[int]()
        for line in _of(lines, tags):
            if line.id_at(1) in met:
                raise line.refused(f"vertex {line.words[1]} was there before", "give every vertex one line")
            met.add(line.id_at(1))
    if not _of(lines, MOTIONS):
        raise UserError(f"{path}: no edge between poses in it; give a graph with {', '.join(MOTIONS)}")
    return lines


def _of(lines: Lines, tags: Iterable[str]) -> list[Line]:
    """The lines of these tags, tag by tag."""
    return [line for tag in tags for line in lines[tag]]


def _sensor(path: Path, lines: Lines) -> Sensor:
    """What sees the landmarks: the same in all lines."""
    tags = [tag for tag in SIGHTS if lines[tag]]
    if not tags:
        raise UserError(f"{path}: no landmark is seen in it, only poses; give a graph with {', '.join(SIGHTS)}")
    sensor = SENSORS[tags[0]]
    for tag in tags:
        if SENSORS[tag] != sensor:
            what = f"a sensor of kind {SENSORS[tag]} beside one of {sensor}"
            raise lines[tag][0].refused(what, "keep the edges of one kind")
    return sensor


# --- edges between poses -----------------------------------------------------------------------


def _motions(lines: Lines, *, isam: bool) -> Edges:
    """The edges between poses in the order of the file, as increments with covariances."""
    edges = list[Line](), list[Float](), list[Float]()
    for tag in MOTIONS:
        if not (found := lines[tag]):
            continue
        numbers = np.array([line.numbers(3) for line in found])
        entries = numbers[:, 3 + TORO_ORDER] if tag == "EDGE2" else numbers[:, 3:]
        is_stated = tag == "ODOMETRY"
        covs = _stated(found, entries, 3, isam=isam) if is_stated else _inverse(found, from_triangles(entries, 3))
        for collected, more in zip(edges, (found, numbers[:, :3], covs), strict=True):
            collected.extend(more)
    order = sorted(range(len(edges[0])), key=lambda at: edges[0][at].number)
    found = [edges[0][at] for at in order]
    ids = np.array([[line.id_at(1), line.id_at(2)] for line in found], dtype=np.int64)
    return Edges(found, ids, np.array(edges[1])[order], np.array(edges[2])[order])


def _stated(lines: list[Line], entries: Float, size: int, *, isam: bool) -> Float:
    """Covariances of the entries that end ODOMETRY and LANDMARK: their own, or of iSAM's square root of information."""
    if isam:
        root = np.triu(from_triangles(entries, size))
        return _inverse(lines, root.swapaxes(1, 2) @ root)
    covs = from_triangles(entries, size)
    require_covariances(lines, covs, "the covariance", REMEDY, definite=size == 2)  # a motion's may be singular
    return covs


def _inverse(lines: list[Line], information: Float) -> Float:
    require_covariances(lines, information, "the information matrix", REMEDY)
    return inverted(information)


# --- the start ---------------------------------------------------------------------------------


def _start(lines: Lines) -> tuple[int, Line] | None:
    """The pose that is fixed or has a prior, if there is one, and where this stands."""
    found = [(line.id_at(at), line) for line in lines["FIX"] for at in range(1, len(line.words))]
    found += [(line.id_at(1), line) for line in lines[PRIOR]]
    poses = {pose for pose, _ in found}
    if len(poses) > 1 or len(lines[PRIOR]) > 1:
        raise found[-1][1].refused("more than the start of the path is known", "fix one pose, the first")
    return found[0] if found else None


def _prior(lines: Lines, first: int) -> tuple[Float, Float]:
    """Mean (3,) and covariance (3, 3) of the first pose."""
    if lines[PRIOR] and not lines["FIX"]:
        numbers = np.array([lines[PRIOR][0].numbers(2)])
        turn = np.eye(3)
        turn[:2, :2] = rotation(numbers[0, 2])
        return numbers[0, :3], turn @ _inverse(lines[PRIOR], from_triangles(numbers[:, 3:], 3))[0] @ turn.T
    vertices = [line.numbers(2) for line in _of(lines, ("VERTEX_SE2", "VERTEX2")) if line.id_at(1) == first]
    return np.array(vertices[0]) if vertices else np.zeros(3), np.zeros((3, 3))


# --- landmarks ---------------------------------------------------------------------------------


class _Sights(NamedTuple):
    """Step (M,), landmark (M,), value (M, d) and covariance (M, d, d) of observations."""

    step: Int
    landmark: Int
    value: Float
    cov: Float


def _sights(lines: Lines, step_of: dict[int, int], *, isam: bool) -> _Sights:
    """The observations, in the order of the file."""
    found = sorted(_of(lines, SIGHTS), key=lambda line: line.number)
    poses = {line.id_at(1) for line in _of(lines, ("VERTEX_SE2", "VERTEX2"))}
    for line in found:
        if line.id_at(1) not in step_of:
            raise line.refused(f"pose {line.words[1]} is not on the path", "correct the id")
        if line.words[0] in ("EDGE_SE2_XY", "EDGE_BEARING_SE2_XY") and line.id_at(2) in poses:
            raise line.refused(f"vertex {line.words[2]} is a pose, not a landmark", "correct the id")
    step = np.array([step_of[line.id_at(1)] for line in found], dtype=np.int64)
    landmark = np.array([line.id_at(2) for line in found], dtype=np.int64)
    numbers = np.array([line.numbers(3) for line in found])
    return _Sights(step, landmark, *_measured(found, numbers, isam=isam))


def _measured(lines: list[Line], numbers: Float, *, isam: bool) -> tuple[Float, Float]:
    """Values (M, d) and covariances (M, d, d) of what ends the lines of one sensor."""
    match SENSORS[lines[0].words[0]]:
        case "position":
            stated = np.array([line.words[0] == "LANDMARK" for line in lines])
            covs = np.empty((len(lines), 2, 2))
            theirs = [line for line, is_stated in zip(lines, stated, strict=True) if is_stated]
            others = [line for line, is_stated in zip(lines, stated, strict=True) if not is_stated]
            covs[stated] = _stated(theirs, numbers[stated, 2:], 2, isam=isam)
            covs[~stated] = _inverse(others, from_triangles(numbers[~stated, 2:], 2))
            return numbers[:, :2], covs
        case "bearing":
            return wrap(numbers[:, :1]), _inverse(lines, numbers[:, 1:, None])
        case _:
            bearing, distance, *sigmas = numbers.T
            if (wrong := (distance < 0.0) | (np.min(sigmas, axis=0) <= 0.0)).any():
                raise lines[int(np.argmax(wrong))].refused("a range below 0, or a sigma not above it", "correct it")
            return np.column_stack([distance, wrap(bearing)]), diagonal_covariances(np.column_stack(sigmas[::-1]))
