"""A transaction of bearing-only filters: it also restores provisional landmarks."""

from __future__ import annotations

import copy
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any

from slamgauge.ekf.bearings.initialiser import RayRecorder
from slamgauge.ekf.maps.landmark_ids import Ids
from slamgauge.ekf.maps.landmark_map import LandmarkMap
from slamgauge.ekf.maps.transaction import transaction

MUTABLE = (Ids, RayRecorder)  # types of changing objects within parts


@contextmanager
def transaction_with(landmarks: LandmarkMap, *parts: object) -> Generator[None]:
    """Restore the map and the attributes of `parts` if the body of the `with` statement raises.

    Arrays in `parts` are not copied: filters replace them and never change them in place.
    """
    before = [_copies(vars(part)) for part in parts]
    try:
        with transaction(landmarks):
            yield
    except BaseException:
        for part, attributes in zip(parts, before, strict=True):
            vars(part).update(attributes)
        raise


def _copies(values: Mapping[Any, object]) -> dict[Any, object]:
    return {key: _copy(each) for key, each in values.items()}


def _copy(value: object) -> object:
    """Return a copy that later changes do not affect."""
    if isinstance(value, dict):
        return _copies(value)
    if isinstance(value, list):
        return [_copy(each) for each in value] if value and isinstance(value[0], list) else [*value]
    if isinstance(value, set):
        return {*value}
    if isinstance(value, MUTABLE):
        kept = copy.copy(value)
        vars(kept).update(_copies(vars(value)))
        return kept
    return value
