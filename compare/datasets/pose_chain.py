"""The path along the edges of a pose graph.

If all edges make up a single path, it is this one. It begins at the pose that is known at the start, else at the end
with the smaller id. Otherwise the path goes from id to id in increasing order, by the first edge between each two. All
other edges close loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.storage.text_lines import Line
from slamgauge.se2 import between, rotation


class Edges(NamedTuple):
    """Edges in the order of a file.

    Attributes:
        lines: Their lines.
        ids: (n, 2) poses i and j.
        increments: (n, 3) pose j in the frame of pose i [m, m, rad].
        covs: (n, 3, 3) of their errors z^-1 x_i^-1 x_j, in the frame of pose j.
    """

    lines: Sequence[Line]
    ids: Int
    increments: Float
    covs: Float


class Chain(NamedTuple):
    """Ids of the N+1 poses of a path, its increments (N, 3) with covariances (N, 3, 3), number of dropped edges."""

    poses: list[int]
    increments: Float
    covs: Float
    dropped: int


def chained(edges: Edges, *, drop_loop_edges: bool, start: tuple[int, Line] | None) -> Chain:
    """Return the path.

    An edge that leads backwards is reversed: its error is then -Ad(z) times what it was, and its cost is the same.

    Args:
        edges: All edges of the graph.
        drop_loop_edges: Whether edges that are not on the path are dropped; else they are refused.
        start: The pose at which the path must begin, and the line that states it.

    Raises:
        UserError: the edges have no such path, or others are not on it; with the line.
    """
    for line, (i, j) in zip(edges.lines, edges.ids.tolist(), strict=True):
        if i == j:
            raise line.refused(f"pose {i} is joined to itself", "correct the ids")
    poses, path = _single_path(edges.ids, None if start is None else start[0]) or _in_order_of_ids(edges)
    closes_loop = np.ones(len(edges.lines), dtype=bool)
    closes_loop[path] = False
    if closes_loop.any() and not drop_loop_edges:
        at = int(np.argmax(closes_loop))
        i, j = edges.ids[at]
        what = f"the edge between the poses {i} and {j} is not on the path; only landmarks may connect other poses"
        if {int(i), int(j)} in [{*pair} for pair in edges.ids[path].tolist()]:
            what = f"a second edge between the poses {i} and {j}; merge both, weighted by their information"
        raise edges.lines[at].refused(what, "drop such edges with `import g2o --drop-loop-edges`")
    if start is not None and start[0] != poses[0]:
        raise start[1].refused(f"pose {start[0]} is known, but the path begins at {poses[0]}", "fix only that one")
    backwards = edges.ids[path, 0] != poses[:-1]
    return Chain(poses, *_reversed(edges.increments[path], edges.covs[path], backwards), int(closes_loop.sum()))


def _single_path(ids: Int, start: int | None) -> tuple[list[int], list[int]] | None:
    """Return poses and edges of the path that all edges make up; None if they are not a single path."""
    at_pose: dict[int, list[int]] = {}
    for edge, pair in enumerate(ids.tolist()):
        for pose in pair:
            at_pose.setdefault(pose, []).append(edge)
    ends = sorted(pose for pose, edges in at_pose.items() if len(edges) == 1)
    if len(ends) != 2 or any(len(edges) > 2 for edges in at_pose.values()):
        return None
    poses, path = [start if start in ends else ends[0]], list[int]()
    while further := [edge for edge in at_pose[poses[-1]] if edge not in path[-1:]]:
        path.append(further[0])
        poses.append(int(ids[further[0]].sum()) - poses[-1])
    return (poses, path) if len(path) == len(ids) else None


def _in_order_of_ids(edges: Edges) -> tuple[list[int], list[int]]:
    """Return poses and edges of the path from id to id."""
    first: dict[tuple[int, int], int] = {}
    for edge, (i, j) in enumerate(edges.ids.tolist()):
        first.setdefault((min(i, j), max(i, j)), edge)
    poses = np.unique(edges.ids).tolist()
    path = list[int]()
    for pair in pairwise(poses):
        if pair not in first:
            line = next(line for line, ids in zip(edges.lines, edges.ids, strict=True) if pair[1] in ids)
            what = f"no edge joins the poses {pair[0]} and {pair[1]}, and the edges are not a single path"
            raise line.refused(what, "join all poses to one path, their ids in its order")
        path.append(first[pair])
    return poses, path


def _reversed(increments: Float, covs: Float, backwards: Marks) -> tuple[Float, Float]:
    """Reverse the increments (n, 3), with covariances (n, 3, 3), that are marked `backwards` (n,)."""
    adjoint = adjoints(increments[backwards])
    increments, covs = increments.copy(), covs.copy()
    increments[backwards] = between(increments[backwards], np.zeros(3))
    covs[backwards] = adjoint @ covs[backwards] @ adjoint.swapaxes(1, 2)
    return increments, covs


def adjoints(increments: Float) -> Float:
    """Return adjoints Ad(z) (n, 3, 3) of increments z (n, 3): z exp(v) = exp(Ad(z) v) z, v = (x, y, heading)."""
    x, y, heading = increments.T
    adjoint = np.zeros((len(increments), 3, 3))
    adjoint[:, :2, :2] = rotation(heading)
    adjoint[:, 0, 2], adjoint[:, 1, 2], adjoint[:, 2, 2] = y, -x, 1.0
    return adjoint
