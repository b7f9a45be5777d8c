"""Nothing or all, for what bearings have begun: the books of provisional landmarks are put back with the map."""

from __future__ import annotations

import copy
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any

from slamgauge.ekf.bearings.inverse_depth import Depth
from slamgauge.ekf.bearings.ray_recorder import RayRecorder
from slamgauge.ekf.bearings.rays import Ray
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.scan_clock import ScanClock
from slamgauge.ekf.maps.transaction import undone_if_refused

BOOKS = (Depth, Ids, Ray, RayRecorder, ScanClock)  # objects within books that change


@contextmanager
def all_undone_if_refused(landmarks: LandmarkMap, *books: object) -> Generator[None]:
    """Leave the map, and the attributes of the books, as they were if what is done within raises.

    Arrays in books are never changed but replaced, and so are kept as they are.
    """
    before = [_all_kept(vars(book)) for book in books]
    try:
        with undone_if_refused(landmarks):
            yield
    except BaseException:
        for book, attributes in zip(books, before, strict=True):
            vars(book).update(attributes)
        raise


def _all_kept(values: Mapping[Any, object]) -> dict[Any, object]:
    return {key: _kept(each) for key, each in values.items()}


def _kept(value: object) -> object:
    """The value as it is now, whatever becomes of it."""
    if isinstance(value, dict):
        return _all_kept(value)
    if isinstance(value, list):
        return [_kept(each) for each in value] if value and isinstance(value[0], list) else [*value]
    if isinstance(value, set):
        return {*value}
    if isinstance(value, BOOKS):
        kept = copy.copy(value)
        vars(kept).update(_all_kept(vars(value)))
        return kept
    return value
