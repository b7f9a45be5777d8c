"""The Victoria Park recording (ACFR, Sydney) in the text form that GTSAM distributes.

`ODOMETRY i j dx dy dtheta` with the upper triangle of its covariance (xx xy xt yy yt tt), and
`LANDMARK i l x y` with that of its own (xx xy yy): metres, radians, landmarks in the body frame.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.compare.datasets.imported_log import require_max_range
from slamgauge.compare.datasets.text_lines import LARGEST_ID
from slamgauge.compare.storage.covariance_columns import from_triangles
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.validation import LARGEST

_NUMBERS = {"ODOMETRY": 9, "LANDMARK": 5}


class _Edge(NamedTuple):
    """One line of the file: from pose `start` to the pose or landmark `end`."""

    where: str
    start: int
    end: int
    numbers: list[float]


def read_victoria_park(path: str | Path, *, max_range: float = math.inf) -> Recording:
    """The recording of a Victoria Park file: `position` sensor, association known, one step a second.

    Poses and landmarks share one id space, so the odometry edges are chained in file order; landmarks
    keep their ids. The first pose is the origin and fixed, the time stamps are the indices of the poses.

    Args:
        path: The text file.
        max_range: Observations farther than this [m] are left out.

    Raises:
        UserError: With the file, the line and the remedy.
    """
    require_max_range(max_range)
    odometry, sightings = _read_edges(path)
    step_of = _chain(odometry)
    for edge in sightings:
        if edge.start not in step_of:
            raise UserError(f"{edge.where}: pose {edge.start} is on no ODOMETRY line; correct the id")
    near = [edge for edge in sightings if math.hypot(*edge.numbers[:2]) <= max_range]
    near.sort(key=lambda edge: step_of[edge.start])

    increments = np.array([edge.numbers for edge in odometry])
    observations = np.array([edge.numbers for edge in near]).reshape(-1, 5)
    try:
        return Recording(
            stamps=np.arange(len(odometry) + 1, dtype=np.float64),
            prior_mean=np.zeros(3),
            prior_cov=np.zeros((3, 3)),
            odometry=increments[:, :3],
            odometry_cov=from_triangles(increments[:, 3:], 3),
            sensor="position",
            observation_step=np.array([step_of[edge.start] for edge in near], dtype=np.int64),
            observation=observations[:, :2],
            observation_cov=from_triangles(observations[:, 2:], 2),
            landmark=np.array([edge.end for edge in near], dtype=np.int64),
        )
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _read_edges(path: str | Path) -> tuple[list[_Edge], list[_Edge]]:
    """The ODOMETRY and the LANDMARK lines, in file order."""
    edges: dict[str, list[_Edge]] = {"ODOMETRY": [], "LANDMARK": []}
    with explained(path, "read"), Path(path).open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            keyword, *words = line.split() or [""]
            where = f"{path}, line {number}"
            if keyword in edges:
                edges[keyword].append(_edge(where, keyword, words))
            elif keyword:
                raise UserError(f"{where}: {keyword[:20]!r} is neither ODOMETRY nor LANDMARK; remove the line")
    if not edges["ODOMETRY"]:
        raise UserError(f"{path}: no ODOMETRY line in it; give the Victoria Park text file")
    return edges["ODOMETRY"], edges["LANDMARK"]


def _edge(where: str, keyword: str, words: list[str]) -> _Edge:
    expected = _NUMBERS[keyword]
    try:
        start, end = map(int, words[:2])
        numbers = [float(word) for word in words[2:]]
    except ValueError:
        start, end, numbers = -1, -1, []
    are_ids = min(start, end) >= 0 and max(start, end) < LARGEST_ID
    if not are_ids or len(numbers) != expected or not all(abs(number) < LARGEST for number in numbers):
        raise UserError(f"{where}: {keyword} needs two ids >= 0 and {expected} finite numbers; correct the line")
    return _Edge(where, start, end, numbers)


def _chain(odometry: list[_Edge]) -> dict[int, int]:
    """Step of every pose id along the path."""
    step_of = {odometry[0].start: 0}
    reached = odometry[0].start
    for edge in odometry:
        if edge.start != reached:
            raise UserError(f"{edge.where}: starts at pose {edge.start}, but the path is at {reached}; sort the edges")
        if edge.end in step_of:
            raise UserError(f"{edge.where}: pose {edge.end} was there before; give every pose an id of its own")
        reached = edge.end
        step_of[reached] = len(step_of)
    return step_of
