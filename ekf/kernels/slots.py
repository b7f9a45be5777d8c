"""Slots of landmark ids in the state, compiled."""

from __future__ import annotations

from slamgauge.arrays import Int
from slamgauge.jit import kernel


@kernel
def find_slots(sorted_ids: Int, sorted_slots: Int, ids: Int, slots: Int) -> int:
    """Fill `slots` with the slot of each id by bisection, -1 for an unmapped id; return the number of unmapped ids."""
    unmapped = 0
    for i in range(len(ids)):
        low, high = 0, len(sorted_ids)
        while low < high:
            middle = (low + high) // 2
            if sorted_ids[middle] < ids[i]:
                low = middle + 1
            else:
                high = middle
        if low < len(sorted_ids) and sorted_ids[low] == ids[i]:
            slots[i] = sorted_slots[low]
        else:
            slots[i] = -1
            unmapped += 1
    return unmapped
