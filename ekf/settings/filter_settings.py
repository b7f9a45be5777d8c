"""Settings of the filters that `slamgauge.ekf` provides as functions from a recording to an estimate."""

from __future__ import annotations

from dataclasses import dataclass

from slamgauge.ekf.settings.association import NEAREST_NEIGHBOUR, Association
from slamgauge.ekf.settings.initialisation import Initialisation, Rays
from slamgauge.ekf.settings.robustness import PLAIN, Robustness


@dataclass(frozen=True)
class FilterSettings:
    """Settings of a filter; those that a recording does not need have no effect.

    Attributes:
        association: how observations find their landmarks where the recording has no ids.
        initialisation: how landmarks are initialised where the sensor is bearing-only.
        frames: number of steps, evenly spread from the first to the last, at which `Estimate.history` stores the map.
        robust: how updates are guarded against outliers.
    """

    association: Association = NEAREST_NEIGHBOUR
    initialisation: Initialisation = Rays()  # noqa: RUF009 frozen
    frames: int = 0
    robust: Robustness = PLAIN


DEFAULTS = FilterSettings()
