"""Online classes with `predict(increment, cov)`, `update(observations)`, `pose`, `pose_cov` (`slamgauge.OnlineFilter`).

Every run uses a new object. The constructor may have parameters named sensor, prior_mean (3,) and prior_cov (3, 3); it
receives only the named ones. `update` takes one argument, `slamgauge.Observations`, or, if it has three required
parameters, ids, values and covariances. Other parts of the protocol are optional:

* landmark_ids, landmarks, landmark_covs: the map at the end of the run;
* associated: (m,) id of the landmark of each observation of the current step, -1 without one;
* standing(ids): present ids of earlier ids, for filters that merge or delete landmarks;
* the NIS and its degrees of freedom: the result of `update`. They are ignored unless every update returns them.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import Form, no_form, parameters, required, spelt
from slamgauge.estimate import Estimate
from slamgauge.recording import Observations, Recording

START = ("sensor", "prior_mean", "prior_cov")
MAP = ("landmark_ids", "landmarks", "landmark_covs")
ROUNDING = 1e-5  # largest asymmetry of rounding, as a share of two sigmas: 5e-7 after a first covariance of 1000 m^2


def lacks(given: type) -> str:
    """Return the names of methods that a class lacks, or whose parameters are others; empty for an online class.

    `pose` and `pose_cov` may be set by the constructor: they are read after every step.
    """
    predict, update = (required(getattr(given, name, None)) for name in ("predict", "update"))  # `self` is the first
    found = ["predict(increment, cov)"] if len(predict) != 3 else []
    found += ["update(observations)"] if len(update) not in (2, 1 + len(Observations._fields)) else []
    return ", ".join(found)


class OnlineClass(Form):
    """An online class, `kind`, as an estimator."""

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.words = f"online {spelt(kind)}"

    def __call__(self, recording: Recording) -> Estimate:
        """Run a new object of the class over a recording, and return its estimate."""
        steps = recording.steps
        poses, pose_covs = np.empty((steps + 1, 3)), np.empty((steps + 1, 3, 3))
        nis, nis_dof, seconds = np.zeros(steps + 1), np.zeros(steps + 1, np.int64), np.zeros(steps + 1)
        associated, has_nis = [np.zeros(0, np.int64)], True
        slam = _made(self.kind, recording)
        takes_fields = len(required(slam.update)) == len(Observations._fields)
        for step, scan in enumerate(recording.scans()):
            start = perf_counter()
            if step > 0:
                slam.predict(recording.odometry[step - 1].copy(), recording.odometry_cov[step - 1].copy())
            if len(scan.value):
                ids = None if scan.landmark is None else scan.landmark.copy()
                given = Observations(ids, scan.value.copy(), scan.cov.copy())
                returned = slam.update(*given) if takes_fields else slam.update(given)
                associated.append(np.array(getattr(slam, "associated", np.zeros(0)), np.int64))
                has_nis = has_nis and isinstance(returned, tuple) and len(returned) == 2
                nis[step], nis_dof[step] = returned if has_nis else (0.0, 0)
            seconds[step] = perf_counter() - start
            poses[step], pose_covs[step] = slam.pose, slam.pose_cov
        fields: dict[str, Any] = {name: getattr(slam, name) for name in MAP if hasattr(slam, name)}
        if "landmark_covs" in fields:
            fields["landmark_covs"] = _without_rounding(fields["landmark_covs"])
        slots = np.concatenate(associated)
        if hasattr(slam, "associated") and len(slots) == len(recording.observation):
            fields["association"] = slam.standing(slots) if hasattr(slam, "standing") else slots
        if has_nis:
            fields |= {"nis": nis, "nis_dof": nis_dof}
        return Estimate("filtered", poses, _without_rounding(pose_covs), seconds=seconds, **fields)


def _made(kind: type, recording: Recording) -> Any:
    """Return a new object of a class; refuse other required parameters, and a missing pose or covariance."""
    names = [each.name for each in parameters(kind)]
    if others := [name for name in required(kind) if name not in START]:
        raise no_form(kind, f"a constructor without {', '.join(others)}: it may have {', '.join(START)}")
    slam = kind(**{name: getattr(recording, name) for name in names if name in START})
    lacking = [name for name in ("pose", "pose_cov") if not hasattr(slam, name) or callable(getattr(slam, name))]
    if lacking:
        raise no_form(kind, f"{', '.join(lacking)}: properties (@property), or set by its constructor")
    return slam


def _without_rounding(given: Any) -> Float:
    """Return covariances (n, d, d) without asymmetry of rounding, which `P - K H P` causes.

    A larger asymmetry stays: `Estimate` refuses it.
    """
    covs = np.array(given, np.float64)
    if covs.ndim != 3:
        return covs  # refused by `Estimate`, unless it is empty
    transposed = covs.swapaxes(1, 2)
    sigmas = np.sqrt(np.abs(np.diagonal(covs, axis1=1, axis2=2)))
    allowed = ROUNDING * sigmas[:, :, None] * sigmas[:, None, :]
    is_rounding = (np.abs(covs - transposed) <= allowed).all(axis=(1, 2), keepdims=True)
    return np.where(is_rounding, (covs + transposed) / 2, covs)
