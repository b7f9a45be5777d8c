"""Adding, removing and merging landmarks of a map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.ekf.kernels import map_edits as kernels
from slamgauge.ekf.kernels.augmentation import augment
from slamgauge.ekf.kernels.linear_update import append_linear
from slamgauge.ekf.maps.input_checks import DIVERGED
from slamgauge.ekf.maps.landmark_map import LandmarkMap, two_rows
from slamgauge.errors import UserError


class NewEntries(NamedTuple):
    """New state entries, two for each landmark: a linear function J x + noise of entries x of the state."""

    values: Float  # (2m,) positions relative to `MapState.origin`
    columns: Int  # (c,) entries x
    jacobian: Float  # (2m, c) J
    noise_cov: Float  # (2m, 2m)
    points: Sequence[bool]  # (m,) whether they are positions, which rotate with the map (see `kernels.update`)


def replace_map(landmarks: LandmarkMap, ids: Int, positions: Float, cov: Float) -> None:
    """Replace all landmarks.

    Args:
        landmarks: the map.
        ids: (L,) landmarks.
        positions: (L, 2) [m] in the world frame.
        cov: (3 + 2L, 3 + 2L) covariance, the robot first.
    """
    state, size = landmarks.state, 3 + 2 * len(ids)
    state.reserve(size)
    state.resize(size)
    belief = state.belief
    belief.state[3:size] = belief.point[3:size] = np.ravel(positions - state.origin)
    belief.cov[:size, :size] = cov
    belief.points[:] = True
    state.set_ids(ids)


def add_landmarks(landmarks: LandmarkMap, ids: Int, values: Float, covs: Float) -> None:
    """Map new landmarks (m,) at their first observations (m, 2), with covariances (m, 2, 2).

    For a bearing-only sensor the observations are ranges and bearings; the caller chooses the ranges.

    Raises:
        UserError: positions or covariances that are not finite; nothing has changed.
    """
    state = landmarks.state
    first, last = state.size, state.size + 2 * len(ids)
    state.reserve(last)
    belief = state.belief
    augment(landmarks.correction.code, belief, *two_rows(values, covs))
    added = (belief.state[first:last], np.diagonal(belief.cov)[first:last])
    if not all(np.isfinite(each).all() for each in added):
        raise UserError(f"observation: the landmarks of this scan are not finite; {DIVERGED}")
    state.resize(last)
    state.set_ids(np.concatenate([state.ids, ids]))


def add_entries(landmarks: LandmarkMap, ids: Int, new: NewEntries) -> None:
    """Append entries for `ids` (m,) to the state."""
    state = landmarks.state
    first, size = state.size, state.size + len(new.values)
    state.reserve(size)
    belief = state.belief
    belief.state[first:size] = belief.point[first:size] = new.values
    append_linear(belief, new.columns, new.jacobian, new.noise_cov)
    belief.points[(first - 3) // 2 : (size - 3) // 2] = new.points
    state.resize(size)
    state.set_ids(np.concatenate([state.ids, ids]))


def remove_landmark(landmarks: LandmarkMap, slot: int) -> None:
    """Remove a landmark (marginalise it); the last landmark moves into its slot."""
    state = landmarks.state
    kernels.remove_landmark(state.belief, slot)
    state.resize(state.size - 2)
    ids = state.ids.copy()
    ids[slot] = ids[-1]
    state.set_ids(ids[:-1])


def merge_landmarks(landmarks: LandmarkMap, kept: int, gone: int) -> None:
    """Merge the landmarks in two slots: the merged one is in slot `kept`, and `gone` is removed."""
    state = landmarks.state
    update = kernels.equate_landmarks(state.belief, kept, gone)
    if np.isfinite(update.nis):
        landmarks.correction.retract(update.dx)
    remove_landmark(landmarks, gone)


def find_duplicates(landmarks: LandmarkMap, slots: Int, apart: Marks, gate: float) -> Int:
    """Return pairs of slots (p, 2) that may be the same landmark; see `kernels.map_edits.find_duplicates`."""
    return kernels.find_duplicates(landmarks.state.belief, slots, apart, gate)
