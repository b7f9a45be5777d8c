"""Tracks: probation, ids that are never used again, merging."""

from __future__ import annotations

import numpy as np

from slamgauge.ekf import SlamFilter
from slamgauge.ekf.kernels.belief import NONE
from slamgauge.ekf.maps.tracks import Tracks
from slamgauge.ekf.settings import MapManagement


class World:
    """Tracks of a real filter with exact observations."""

    def __init__(self, management: MapManagement | None) -> None:
        self.slam = SlamFilter("position", np.zeros(3), np.zeros((3, 3)))
        self.tracks = Tracks(self.slam.map, management)
        self.places: dict[int, tuple[float, float]] = {}

    def scan(self, *seen: int, new: tuple[tuple[float, float], ...] = ()) -> list[int]:
        """Close a scan that observes the ids `seen` and maps landmarks `new`; return the new ids."""
        born = self.slam.map.take_ids(len(new))
        self.slam.map.add(born, np.array(new).reshape(-1, 2), np.tile(1e-4 * np.eye(2), (len(new), 1, 1)))
        self.places.update(zip(born.tolist(), new, strict=True))
        self.tracks.close_scan(np.array([*seen, *born.tolist()], dtype=np.int64))
        self.check()
        return born.tolist()

    def check(self) -> None:
        """Check that ids and slots agree."""
        ids = self.slam.landmark_ids.tolist()
        assert len(set(ids)) == len(ids) == len(self.tracks.confirmed)
        places = np.array([self.places[i] for i in ids]).reshape(-1, 2)
        np.testing.assert_allclose(self.slam.landmarks, places, rtol=0, atol=1e-9)
        known = np.arange(len(self.places))
        standing = self.tracks.standing(known)
        np.testing.assert_array_equal(self.tracks.standing(standing), standing)
        assert set(standing.tolist()) - {NONE} <= set(self.confirmed)
        np.testing.assert_array_equal(standing[self.confirmed], self.confirmed)

    @property
    def confirmed(self) -> list[int]:
        return self.slam.landmark_ids[self.tracks.confirmed].tolist()

    def standing(self, *ids: int) -> list[int]:
        return self.tracks.standing(np.array(ids, dtype=np.int64)).tolist()


def test_without_map_management_every_track_is_a_landmark() -> None:
    world = World(None)
    assert world.scan(new=((1.0, 0.0), (1.0, 0.0))) == [0, 1]
    for _ in range(20):
        world.scan()
    assert world.confirmed == [0, 1]
    assert world.standing(1, NONE, 0) == [1, NONE, 0]


def test_a_track_is_confirmed_by_its_last_observation_in_probation_and_deleted_without_it() -> None:
    world = World(MapManagement(sights=3, probation=5))
    early, late, never = world.scan(new=((1.0, 0.0), (2.0, 0.0), (3.0, 0.0)))
    world.scan(early)
    assert world.confirmed == []
    assert world.standing(early, late, never) == [NONE, NONE, NONE]
    world.scan(early, late, never)
    assert world.confirmed == [early]
    world.scan()
    assert sorted(world.slam.landmark_ids.tolist()) == [early, late, never]  # after four scans they are on probation
    world.scan(late)
    assert sorted(world.confirmed) == [early, late]
    assert sorted(world.slam.landmark_ids.tolist()) == [early, late]
    assert world.standing(never, late, NONE, early) == [NONE, late, NONE, early]
    for _ in range(10):
        world.scan()
    assert sorted(world.confirmed) == [early, late]  # confirmed tracks remain


def test_ids_are_never_used_again_and_probation_counts_from_each_tracks_own_birth() -> None:
    world = World(MapManagement(sights=2, probation=3))
    assert world.scan(new=((1.0, 0.0), (2.0, 0.0))) == [0, 1]
    assert world.scan(new=((3.0, 0.0),)) == [2]
    world.scan()
    assert world.slam.landmark_ids.tolist() == [2]
    world.scan()
    assert world.slam.landmark_ids.tolist() == []
    assert world.scan(new=((1.0, 0.0),)) == [3]
    assert world.standing(0, 1, 2, 3) == [NONE] * 4
    world.scan(3)
    assert world.standing(0, 1, 2, 3) == [NONE, NONE, NONE, 3]


def test_merged_ids_become_the_oldest_id_also_in_chains() -> None:
    world = World(MapManagement(sights=2, probation=20))
    world.scan(new=((1.0, 0.0), (5.0, 0.0)))  # 0 is on probation, 1 is elsewhere
    world.scan(1, new=((1.0, 0.0),))
    world.scan(new=((1.0, 0.0),))
    world.scan(2)
    assert world.standing(0, 1, 2, 3) == [NONE, 1, 2, NONE]
    world.scan(3)
    assert world.standing(0, 1, 2, 3) == [NONE, 1, 2, 2]  # the younger id was removed
    world.scan(0)
    assert world.standing(0, 1, 2, 3) == [0, 1, 0, 0]
    assert sorted(world.slam.landmark_ids.tolist()) == [0, 1]
    assert world.scan(new=((9.0, 0.0),)) == [4]


def test_landmarks_of_one_scan_are_never_merged_also_not_after_merges_with_others() -> None:
    world = World(MapManagement(sights=1, probation=20))
    world.scan(new=((1.0, 0.0), (1.0, 0.0)))
    for _ in range(3):
        world.scan(0)
        world.scan(1)
    assert sorted(world.confirmed) == [0, 1]
    # one scan observes 2 and 3, and 2 merges into 0: so 3 cannot be 0, only 1
    apart = World(MapManagement(sights=3, probation=20))
    apart.scan(new=((1.0, 0.0),))
    apart.scan(new=((1.0, 0.0), (1.0, 0.0)))
    apart.scan(0)
    apart.scan(0)
    apart.scan(1)
    apart.scan(1)
    assert apart.standing(0, 1, 2) == [0, 0, NONE]
    for _ in range(3):
        apart.scan(2)
        apart.scan(0)
    assert apart.standing(0, 1, 2) == [0, 0, 2]


def test_ids_stay_with_their_landmarks_when_slots_change() -> None:
    """Random tracks; `World.check` tests every scan, and deleted ids never return."""
    rng = np.random.default_rng(7)
    merged = deleted = 0
    for _ in range(10):
        world = World(MapManagement(sights=3, probation=6))
        gone: set[int] = set()
        survivors: dict[int, int] = {}
        for _ in range(40):
            places = tuple((float(rng.integers(0, 6)), 0.0) for _ in range(int(rng.integers(0, 3))))
            alive = world.slam.landmark_ids
            world.scan(*alive[rng.random(len(alive)) < 0.4].tolist(), new=places)
            now = set(world.slam.landmark_ids.tolist())
            ended = set(world.places) - now
            assert gone <= ended
            for i in ended - gone:
                survivors[i] = world.standing(i)[0]
            for i, survivor in survivors.items():
                standing = world.standing(i)[0]
                assert standing in ({NONE} if survivor == NONE else {survivor, *world.standing(survivor)})
                assert standing == NONE or (standing < i and world.places[standing] == world.places[i])
            gone = ended
        deleted += list(survivors.values()).count(NONE)
        merged += len(survivors) - list(survivors.values()).count(NONE)
    assert merged > 20
    assert deleted > 20
