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
from tests.reference.textbook import DenseFilter, Kind, Step, block_diagonal, estimate_of

Pair = tuple[int, int]  # observation, slot


def textbook_nearest_neighbour(recording: Recording, gate: float, kind: Kind) -> Estimate:
    """Run a filter with nearest-neighbour association; landmark ids are 0, 1, ... in the order of their addition."""
    if kind == "standard":
        return textbook_ekf(replace(recording, landmark=None), Association(gate=gate))
    slam = DenseFilter(recording.sensor, recording.prior_mean, recording.prior_cov, kind)
    association, steps = list[int](), list[Step]()
    for k, scan in enumerate(recording.scans()):
        if k > 0:
            slam.predict(recording.odometry[k - 1], recording.odometry_cov[k - 1])
        nis, dof = 0.0, 0
        for z, R in zip(scan.value, scan.cov, strict=True):
            distances = slam.squared_distances(z, R)
            if distances.min(initial=np.inf) <= gate:
                slot = int(np.argmin(distances))
                nis, dof = nis + slam.update([slot], z[None], R[None]), dof + 2
            else:
                slot = slam.landmark_count
                slam.augment(z, R)
            association.append(slot)
        steps.append((slam.x[:3], slam.cov[:3, :3], nis, dof))
    return estimate_of(slam, np.arange(slam.landmark_count), steps, np.array(association, dtype=np.int64))


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
    slots = np.arange((len(x) - 3) // 2)
    no_noise = np.zeros((len(slots), 2, 2))
    copies = [np.tile(value, (len(slots), 1)) for value in z]
    seen = [textbook.linearise(sensor, x, slots, each, no_noise, point) for each in copies]
    innovation = np.array([each.innovation for each in seen])
    jacobian = np.array([textbook.stack(each, len(x))[1].reshape(-1, 2, len(x)) for each in seen])
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
