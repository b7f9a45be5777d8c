"""A map: its state, and its correction. `map_edits` adds, removes and merges landmarks."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from slamgauge.ekf.kernels.warm_up import compile_steps
from slamgauge.ekf.maps.correction_table import Correction, Rule, rule_of
from slamgauge.ekf.maps.input_checks import require_sensor
from slamgauge.ekf.maps.map_correction import MapCorrection
from slamgauge.ekf.maps.map_state import MapState
from slamgauge.sensors import SENSORS


class LandmarkMap:
    """Robot and landmarks, and how they are corrected.

    Args:
        sensor: `range-bearing`, `position` or `bearing` (see `slamgauge.Recording`).
        prior_mean: (3,) start pose.
        prior_cov: (3, 3) its covariance; zero is legal.
        correction: name or rule; see `correction_table`.
        landmarks: initial room; the map grows beyond that by itself.
        tails: degrees of freedom of the observations' noise (see `kernels.student_t_weights`).

    Attributes:
        state: belief, ids, and where landmarks are in the state.
        correction: prediction and update.

    Raises:
        UserError: an unknown sensor or correction, an invalid prior, or an invalid number of landmarks.
    """

    def __init__(
        self,
        sensor: str,
        prior_mean: ArrayLike,
        prior_cov: ArrayLike,
        correction: Correction | Rule,
        landmarks: int,
        tails: float = math.inf,
    ) -> None:
        require_sensor(sensor, tuple(SENSORS))
        rule = rule_of(correction)
        self.state = MapState(prior_mean, prior_cov, rule, landmarks)
        compile_steps(rule.update, heavy_tails=tails < math.inf)
        self.correction = MapCorrection(self.state, sensor, rule, tails)
