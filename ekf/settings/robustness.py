"""How filters guard their updates against outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from slamgauge.ekf.settings.validation import check, setting


@dataclass(frozen=True)
class Robustness:
    """How a filter guards its updates against outliers of mapped landmarks.

    Attributes:
        robust: `none`; `gate` leaves out observations with ids that are beyond `gate` (without ids the gate of the
            association does that); `student-t` trusts an observation the less the farther off it is, as if its noise
            had Student's distribution (see `kernels.student_t_weights`), with ids and without.
        gate: largest squared Mahalanobis distance of an observation by itself. The default is exceeded once in a
            thousand (chi-square, 2 degrees of freedom).
        degrees_of_freedom: of Student's distribution; the fewer, the heavier its tails (1 is Cauchy's).
    """

    robust: Literal["none", "gate", "student-t"] = "none"
    gate: float = setting(13.8, lambda g: g > 0.0, "{} lets nothing pass; choose it above 0")
    degrees_of_freedom: float = setting(1.0, lambda n: n > 0.0, "{} is no distribution; choose it above 0")

    def __post_init__(self) -> None:
        check(self)

    @property
    def known_gate(self) -> float | None:
        """The gate for observations with ids, if there is to be one."""
        return self.gate if self.robust == "gate" else None

    @property
    def tails(self) -> float:
        """Degrees of freedom of the noise; infinitely many are Gauss's."""
        return self.degrees_of_freedom if self.robust == "student-t" else math.inf


PLAIN = Robustness()
