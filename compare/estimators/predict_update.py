"""Two functions, `predict(eta, P, z_odo) -> eta, P` and `update(eta, P, z) -> eta, P`, that associate by themselves.

eta (3+2n,), z_odo (3,) the body-frame increment [m, m, rad], z (m, 2) ranges [m] and bearings [rad]. Q (3, 3) of the
increment and R (2, 2), where their modules have such globals, are the recording's; otherwise noise is what they have
inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.signatures import called, pair, required_of_pair
from slamgauge.compare.estimators.state_log import Trail
from slamgauge.compare.estimators.user_code import OwnCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

PREDICT, UPDATE = "predict", "update"


def description(given: Fresh) -> str | None:
    """What people are told of one of both functions, beside the other; None for anything else."""
    found = required_of_pair(given, (PREDICT, UPDATE), (3, 3))
    if found is None:
        return None
    return f"functions {PREDICT} ({', '.join(found[0])}) and {UPDATE} ({', '.join(found[1])})"


@dataclass(frozen=True)
class PredictUpdate:
    """Both functions as an estimator.

    Attributes:
        code: where one of them comes from; the other one stands beside it.
    """

    code: Code

    def __call__(self, recording: Recording) -> Estimate:
        """Run them over a recording; ids, where it has any, they do not see.

        Raises:
            OwnCodeError: a recording that they cannot be fed with, or what they return is no state.
        """
        if not SENSORS[recording.sensor].has_range:
            raise OwnCodeError("predict and update take ranges and bearings; give a recording that has them")
        trail = Trail(recording, ("eta", "P"))
        belief: list[Any] = [recording.prior_mean.copy(), recording.prior_cov.copy()]
        with self.code.fresh() as fresh:
            predict, update = fresh.beside[PREDICT], fresh.beside[UPDATE]

            def advance(step: int, scan: Observations) -> tuple[Any, Any]:
                if step > 0:
                    _tell(predict, "Q", recording.odometry_cov[step - 1])
                    belief[:] = pair(called(predict, *belief, recording.odometry[step - 1].copy()), PREDICT)[:2]
                if len(scan.value):
                    _tell(update, "R", scan.cov[0])
                    belief[:] = pair(called(update, *belief, scan.value.copy()), UPDATE)[:2]
                return belief[0], belief[1]

            for step, scan in enumerate(recording.scans()):
                trail.step(step, None, lambda step=step, scan=scan: advance(step, scan))
        return trail.estimate()


def _tell(function: Any, name: str, cov: Float) -> None:
    """Replace a global covariance of the function, if there is one of that size."""
    space = getattr(function, "__globals__", {})
    if name in space and np.shape(space[name]) == cov.shape:
        space[name] = cov.copy()
