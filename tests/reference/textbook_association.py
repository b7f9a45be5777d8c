"""Dense and slow textbook association, the reference for `ekf.associating_filter`.

`textbook_nearest_neighbour` is `slamgauge.textbook_ekf` without ids, and the same rule with the filters of
`tests/reference/textbook.py`. It takes one observation after another: the landmark with the smallest squared
Mahalanobis distance within the gate corrects the state, and if none is within the gate a new landmark is added. `Scan`
contains all innovations and Jacobians of one scan, and `brute_force_joint` enumerates its assignments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from slamgauge.arrays import Float
from slamgauge.ekf import Association, textbook, textbook_ekf
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from tests.reference.textbook import (
    KEEP_FIRST,
    Jacobians,
    Kind,
    additive_from_invariant,
    augment,
    block_diagonal,
    dense,
    linearised,
    predict_invariant,
    predict_standard,
    update,
    update_iterated,
)

Pair = tuple[int, int]  # observation, slot

NONE = -1


def textbook_nearest_neighbour(recording: Recording, gate: float, kind: Kind) -> Estimate:
    """Run a filter with nearest-neighbour association; landmark ids are 0, 1, ... in the order of their addition."""
    if kind == "standard":
        return textbook_ekf(replace(recording, landmark=None), Association(gate=gate))
    invariant = kind == "invariant"
    jacobians: Jacobians = "invariant" if invariant else "observable" if kind == "observable" else "additive"
    x, P = recording.prior_mean.copy(), recording.prior_cov.copy()
    first = x.copy()
    if invariant:
        back = np.linalg.inv(additive_from_invariant(x))
        P = back @ P @ back.T
    poses, pose_covs, nis, dof, association = [], [], [], [], []
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            predict = predict_invariant if invariant else predict_standard
            point = first if kind in KEEP_FIRST else x
            x, P = predict(x, point, P, recording.odometry[k - 1], recording.odometry_cov[k - 1])
            first[:3] = x[:3]
        nis.append(0.0)
        dof.append(0)
        for z, R in zip(scan.value, scan.cov, strict=True):
            point = first if kind in KEEP_FIRST else x
            distances = squared_distances(recording.sensor, x, point, P, z, R, kind=jacobians)
            if len(distances) and min(distances) <= gate:
                slot = int(np.argmin(distances))
                sight = [slot], z[None], R[None]
                if kind == "iterated":
                    x, P, step_nis = update_iterated(recording.sensor, x, P, *sight)
                else:
                    x, P, step_nis = update(recording.sensor, x, point, P, *sight, kind=jacobians)
                nis[-1] += step_nis
                dof[-1] += 2
                association.append(slot)
            else:
                association.append((len(x) - 3) // 2)
                x, P = augment(recording.sensor, x, point, P, z, R, invariant=invariant)
                first = np.concatenate([first, x[-2:]])
        full = additive(x, P, invariant=invariant)
        poses.append(x[:3])
        pose_covs.append(full[:3, :3])
    full = additive(x, P, invariant=invariant)
    return Estimate(
        kind="filtered",
        poses=np.array(poses),
        pose_covs=np.array(pose_covs),
        landmark_ids=np.arange((len(x) - 3) // 2),
        landmarks=x[3:].reshape(-1, 2),
        landmark_covs=np.array([full[i : i + 2, i : i + 2] for i in range(3, len(x), 2)]).reshape(-1, 2, 2),
        association=np.array(association, dtype=np.int64),
        nis=np.array(nis),
        nis_dof=np.array(dof),
    )


def additive(x: Float, P: Float, *, invariant: bool) -> Float:
    """Return the covariance of the additive error."""
    D = additive_from_invariant(x) if invariant else np.eye(len(x))
    full = D @ P @ D.T
    return (full + full.T) / 2


def squared_distances(
    sensor: str, x: Float, point: Float, P: Float, z: Float, R: Float, *, kind: Jacobians = "additive"
) -> Float:
    """Return d^2 (L,) of one observation and every landmark, with Jacobians at `point`."""
    count = (len(x) - 3) // 2
    copies = np.tile(z, (count, 1)), np.tile(R, (count, 1, 1))
    return textbook.squared_distances(P, linearised(sensor, x, point, [*range(count)], *copies, kind=kind))


@dataclass(frozen=True)
class Scan:
    """Dense innovations and Jacobians of m observations and L landmarks."""

    innovation: Float  # (m, L, 2)
    jacobian: Float  # (m, L, 2, n)
    P: Float  # (n, n)
    R: Float  # (m, 2, 2)

    def distance(self, pairs: Sequence[Pair]) -> float:
        """Return the joint d^2 of the pairs."""
        if not pairs:
            return 0.0
        v = np.concatenate([self.innovation[pair] for pair in pairs])
        H = np.concatenate([self.jacobian[pair] for pair in pairs])
        S = H @ self.P @ H.T + block_diagonal(self.R[[i for i, _ in pairs]])
        return float(v @ np.linalg.inv(S) @ v)

    def distances(self) -> Float:
        """Return d^2 (m, L) of every single pair."""
        m, landmarks = self.innovation.shape[:2]
        return np.array([[self.distance([(i, slot)]) for slot in range(landmarks)] for i in range(m)])


def dense_scan(sensor: str, x: Float, point: Float, P: Float, z: Float, R: Float) -> Scan:
    """Return the scan of observations (m, 2) with covariances (m, 2, 2), with Jacobians at `point`."""
    slots = list(range((len(x) - 3) // 2))
    no_noise = np.zeros((len(slots), 2, 2))
    copies = [np.tile(value, (len(slots), 1)) for value in z]
    rows = [dense(linearised(sensor, x, point, slots, each, no_noise), len(x)) for each in copies]
    innovation = np.array([v.reshape(-1, 2) for v, _ in rows])
    jacobian = np.array([H.reshape(-1, 2, len(x)) for _, H in rows])
    return Scan(innovation, jacobian, P, R)


def search_order(scan: Scan, gate: float) -> list[tuple[int, list[int]]]:
    """Return the observations with landmarks inside the gate, fewest landmarks first, nearest landmark first."""
    distances = scan.distances()
    found = [(i, [int(s) for s in np.argsort(row) if row[s] <= gate]) for i, row in enumerate(distances)]
    return sorted([entry for entry in found if entry[1]], key=lambda entry: len(entry[1]))


def brute_force_joint(scan: Scan, gate: float, quantiles: Float, *, every_subset: bool = False) -> list[Pair]:
    """Return the compatible assignment with the most pairs, and among those the one with the smallest joint d^2.

    An assignment is compatible if its pairs are one to one, each within `gate`, and the first 1, 2, ... pairs in the
    order of `search_order` have a joint d^2 within quantiles[1], [2], ... Branch and bound visits these assignments.
    With `every_subset`, all subsets of the pairs must be within their quantile.
    """
    best: list[Pair] = []
    least = 0.0
    for pairs, distance in _compatible_assignments(scan, search_order(scan, gate), quantiles, [], 0.0):
        if len(pairs) < len(best) or (len(pairs) == len(best) and distance >= least):
            continue
        if not every_subset or are_compatible_in_every_subset(scan, pairs, quantiles):
            best, least = pairs, distance
    return best


def _compatible_assignments(
    scan: Scan, rest: list[tuple[int, list[int]]], quantiles: Float, pairs: list[Pair], distance: float
) -> Iterator[tuple[list[Pair], float]]:
    if not rest:
        yield pairs, distance
        return
    (i, slots), *rest = rest
    for slot in slots:
        longer = [*pairs, (i, slot)]
        if slot not in [taken for _, taken in pairs] and scan.distance(longer) <= quantiles[len(longer)]:
            yield from _compatible_assignments(scan, rest, quantiles, longer, scan.distance(longer))
    yield from _compatible_assignments(scan, rest, quantiles, pairs, distance)


def are_compatible_in_every_subset(scan: Scan, pairs: Sequence[Pair], quantiles: Float) -> bool:
    subsets = (subset for size in range(1, len(pairs) + 1) for subset in combinations(pairs, size))
    return all(scan.distance(subset) <= quantiles[len(subset)] for subset in subsets)


def brute_force_ambiguous(scan: Scan, gate: float, margin: float, best: Sequence[Pair]) -> set[int]:
    """Return the observations of `best` with another slot in a neighbouring assignment that is at most `margin` worse.

    In a neighbouring assignment one observation takes a free slot, or two exchange their slots, all within `gate`.
    """
    within = scan.distances() <= gate
    steps: list[tuple[set[int], list[Pair]]] = []
    for i, slot in best:
        free = set(np.flatnonzero(within[i]).tolist()) - {taken for _, taken in best}
        steps += [({i}, [(a, other if a == i else s) for a, s in best]) for other in free]
        for j, other in best:
            if j != i and within[i, other] and within[j, slot]:
                steps.append(({i, j}, [(a, {i: other, j: slot}.get(a, s)) for a, s in best]))
    bound = scan.distance(best) + margin
    return set[int]().union(*(changed for changed, pairs in steps if scan.distance(pairs) <= bound))
