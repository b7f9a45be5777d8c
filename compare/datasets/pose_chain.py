"""The path along the edges of a pose graph.

If all poses make up a single path, it is this one, and ids may have any order. It begins at the pose that is known at
the start, else at the end with the smaller id. Otherwise the path goes from id to id in increasing order, by the first
edge between each two. All other edges close loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.storage.text_lines import Line
from slamgauge.se2 import between, rotation


def path_along(lines: Sequence[Line], ids: Int, start: int | None, *, drop_others: bool) -> tuple[list[int], list[int]]:
    """Return the poses of the path, and its edges as indices.

    Args:
        lines: The n edges.
        ids: (n, 2) poses that they connect.
        start: The pose at which a single path begins if it is one of its ends.
        drop_others: Whether edges that are not on the path are dropped; else they are refused.

    Raises:
        UserError: the edges have no such path, or others are not on it; with the line.
    """
    joined: dict[int, dict[int, int]] = {}  # the first edge from each pose to each neighbour
    for edge, (i, j) in enumerate(ids.tolist()):
        if i == j:
            raise lines[edge].refused(f"pose {i} is joined to itself", "correct the ids")
        joined.setdefault(i, {}).setdefault(j, edge)
        joined.setdefault(j, {}).setdefault(i, edge)
    ends = sorted(pose for pose, neighbours in joined.items() if len(neighbours) == 1)
    poses = [start if start in ends else min(ends, default=-1)]
    if len(ends) == 2 and max(map(len, joined.values())) == 2:
        while further := [each for each in joined[poses[-1]] if each not in poses[-2:]]:
            poses.append(further[0])
    if len(poses) != len(joined):
        poses = sorted(joined)
    for i, j in pairwise(poses):
        if j not in joined[i]:
            what = f"no edge joins the poses {i} and {j}, and the edges are not a single path"
            raise lines[min(joined[j].values())].refused(what, "join all poses to one path, their ids in its order")
    path = [joined[i][j] for i, j in pairwise(poses)]
    others = sorted({*range(len(lines))} - {*path})
    if others and not drop_others:
        i, j = ids[others[0]].tolist()
        what = f"the edge between the poses {i} and {j} is not on the path; only landmarks may connect other poses"
        if joined[i][j] in path:
            what = f"a second edge between the poses {i} and {j}; merge both, weighted by their information"
        raise lines[others[0]].refused(what, "drop such edges with `import g2o --drop-loop-edges`")
    return poses, path


def reversed_where(backwards: Marks, increments: Float, covs: Float) -> tuple[Float, Float]:
    """Reverse the increments (n, 3), with covariances (n, 3, 3), that are marked `backwards` (n,).

    The error of a reversed edge is -Ad(z) times what it was, and its cost is the same.
    """
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
