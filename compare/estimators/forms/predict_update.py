"""Two functions that associate by themselves.

    predict(eta, P, z_odo) -> eta, P          z_odo (3,) the body-frame increment [m, m, rad]
    update(eta, P, z) -> eta, P               z (m, 2) ranges [m] and bearings [rad]

eta is (3+2n,). Globals Q (3, 3) and R (2, 2) of their modules, if they exist, are set to the noise of the recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import called, pair, required
from slamgauge.compare.estimators.forms.state_log import StateLog
from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.compare.estimators.user_code import UserCodeError
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording
from slamgauge.sensors import SENSORS

PREDICT, UPDATE = ("predict", "update")


def description(given: Fresh) -> str | None:
    """Describe `predict` or `update` if its module has both; return None otherwise."""
    functions = [given.names.get(name) for name in (PREDICT, UPDATE)]
    predict, update = (required(function) for function in functions)
    if given.callee not in functions or (len(predict), len(update)) != (3, 3):
        return None
    return f"functions {PREDICT} ({', '.join(predict)}) and {UPDATE} ({', '.join(update)})"


@dataclass(frozen=True)
class PredictUpdate:
    """`predict` and `update` as an estimator; `code` is the source of one of them."""

    code: Code

    def __call__(self, recording: Recording) -> Estimate:
        """Run the functions over a recording, without its ids.

        Raises:
            UserCodeError: the recording lacks ranges or bearings, or a function returns no state.
        """
        if not SENSORS[recording.sensor].has_range:
            raise UserCodeError("predict and update take ranges and bearings; give a recording that has them")
        log = StateLog(recording, ("eta", "P"))
        belief: list[Any] = [recording.prior_mean.copy(), recording.prior_cov.copy()]
        with self.code.fresh() as fresh:
            predict, update = fresh.names[PREDICT], fresh.names[UPDATE]

            def advance(step: int, scan: Observations) -> tuple[Any, Any]:
                if step > 0:
                    _set_noise(predict, "Q", recording.odometry_cov[step - 1])
                    belief[:] = pair(called(predict, *belief, recording.odometry[step - 1].copy()), PREDICT)[:2]
                if len(scan.value):
                    _set_noise(update, "R", scan.cov[0])
                    belief[:] = pair(called(update, *belief, scan.value.copy()), UPDATE)[:2]
                return belief[0], belief[1]

            for step, scan in enumerate(recording.scans()):
                log.step(step, None, lambda step=step, scan=scan: advance(step, scan))
        return log.estimate()


def _set_noise(function: Any, name: str, cov: Float) -> None:
    """Replace a global covariance of the function, if it has one of that size."""
    space = getattr(function, "__globals__", {})
    if name in space and np.shape(space[name]) == cov.shape:
        space[name] = cov.copy()
