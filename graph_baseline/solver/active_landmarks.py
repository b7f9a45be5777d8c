"""The active landmarks of an incremental optimum, and their slots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int
from slamgauge.graph_baseline.problem.linearisation import GraphArrays
from slamgauge.graph_baseline.problem.placement import SURE, triangulate_one
from slamgauge.graph_baseline.problem.preparation import Problem
from slamgauge.sensors import SENSORS

CERTAIN = SURE / 2  # sigma over distance; a landmark with a smaller value is not checked again


class State(NamedTuple):
    """A path and a map; used entries come first."""

    poses: Float  # (N+1, 3)
    landmarks: Float  # (L, 2)


class ActiveLandmarks:
    """Slots of the active landmarks in `state`, and of the observations in `arrays`.

    Args:
        recording: known association.
        arrays: the recording as arrays for kernels; this class writes its `slot`.
        state: current path and map; this class writes the position of a landmark that becomes active.
    """

    def __init__(self, recording: Problem, arrays: GraphArrays, state: State) -> None:
        self._recording, self._arrays, self._state = recording, arrays, state
        self._ids = recording.landmark
        self._slot: dict[int, int] = {}
        self._uncertain: set[int] = set()

    def __len__(self) -> int:
        return len(self._slot)

    @property
    def ids(self) -> Int:
        """(L,) ids in the order of their slots."""
        return np.array(list(self._slot), dtype=np.int64)

    def positions(self) -> Float:
        """Return positions (L, 2) [m] in the order of `ids`."""
        return self._state.landmarks[: len(self)].copy()

    def map_scan(self, newest: int) -> None:
        """Assign slots to the observations of the newest scan; new bearing-only landmarks wait without a slot."""
        rows = slice(*self._arrays.first[newest : newest + 2].tolist())
        names = self._ids[rows].tolist()
        if SENSORS[self._recording.sensor].places_landmarks:
            for row, name in enumerate(names, start=rows.start):
                if name not in self._slot:
                    self._map(name, self._recording.positions_seen(np.array([row]), self._state.poses)[0])
        self._arrays.slot[rows] = [self._slot.get(name, -1) for name in names]

    def map_waiting(self, newest: int, but: set[int]) -> set[int]:
        """Assign slots to waiting landmarks, except `but`, that their bearings place; return these ids."""
        rows = np.arange(self._arrays.first[newest + 1])
        found, ids = set[int](), self._ids[: len(rows)]
        for name in sorted({*ids[self._arrays.slot[rows] < 0].tolist()} - but):
            landmark, sigma = triangulate_one(self._recording, rows[ids == name], self._state.poses)
            if np.isfinite(sigma):
                self._map(name, landmark)
                self._arrays.slot[rows[ids == name]] = self._slot[name]
                found.add(name)
        return found

    def may_place_waiting(self, newest: int, path: Float) -> bool:
        """Return whether bearings from a path place a waiting landmark that the newest pose observes."""
        rows = slice(*self._arrays.first[newest : newest + 2])
        waiting = self._ids[rows][self._arrays.slot[rows] < 0].tolist()
        return any(np.isfinite(triangulate_one(self._recording, self._rows(newest, name), path)[1]) for name in waiting)

    def remove_unplaced(self, newest: int) -> bool:
        """Remove landmarks that their bearings no longer place; return whether any was removed."""
        kept = {name for name in self._slot if name not in self._uncertain or self._is_placed(newest, name)}
        ids = self.ids
        if len(kept) == len(ids):
            return False
        self._uncertain &= kept
        stays = np.isin(ids, list(kept))
        self.set_mapped(newest, ids[stays], self.positions()[stays])
        return True

    def set_mapped(self, newest: int, ids: Int, landmarks: Float) -> None:
        """Assign slots to exactly the landmarks (L, 2) with the given ids (L,)."""
        self._slot = {name: slot for slot, name in enumerate(ids.tolist())}
        self._state.landmarks[: len(ids)] = landmarks
        rows = self._arrays.first[newest + 1]
        self._arrays.slot[:rows] = [self._slot.get(name, -1) for name in self._ids[:rows].tolist()]

    def recheck_all(self) -> None:
        """Mark all landmarks as uncertain, so that `remove_unplaced` checks them."""
        self._uncertain = set(self._slot)

    def _map(self, name: int, landmark: Float) -> None:
        """Assign the next slot to a landmark at the position (2,)."""
        slot = self._slot[name] = len(self._slot)
        self._state.landmarks[slot] = landmark

    def _rows(self, newest: int, name: int) -> Int:
        """Return the rows (n,) of the observations of a landmark up to the newest pose."""
        return np.flatnonzero(self._ids[: self._arrays.first[newest + 1]] == name)

    def _is_placed(self, newest: int, name: int) -> bool:
        """Return whether its bearings place a landmark; mark a landmark with a small sigma as certain."""
        rows = self._rows(newest, name)
        if np.isfinite(triangulate_one(self._recording, rows, self._state.poses, CERTAIN)[1]):
            self._uncertain.remove(name)
            return True
        return bool(np.isfinite(triangulate_one(self._recording, rows, self._state.poses)[1]))
