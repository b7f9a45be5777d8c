"""`Truth`, which only the scores receive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.validation import (
    Record,
    are_among,
    as_array,
    as_distinct_ids,
    as_floats,
    as_ints,
    require_rows,
    store,
    wrap_headings,
)

NOBODY = -1  # landmark of clutter


@dataclass(frozen=True, slots=True, eq=False)
class Truth(Record):
    """Ground truth of a run, which only the scores receive; None stands for a field without ground truth.

    Attributes:
        poses: (N+1, 3); a row of NaN in a gap of the ground truth, a heading of NaN where only the position is known.
        landmark_ids: (L,) distinct ids >= 0.
        landmarks: (L, 2) [m].
        association: (M,) true landmark id of each observation, -1 for clutter.
        outlier: (M,) whether an observation is an outlier.
    """

    poses: Float | None = None
    landmark_ids: Int | None = None
    landmarks: Float | None = None
    association: Int | None = None
    outlier: Marks | None = None

    def __post_init__(self) -> None:
        if self.poses is not None:
            poses = as_array("poses", self.poses, (None, 3))
            position, heading = np.isfinite(poses[:, :2]).all(axis=1), poses[:, 2]
            known = position & (np.isfinite(heading) | np.isnan(heading))
            gap = np.isnan(poses).all(axis=1)
            require_rows(
                "poses", known | gap, poses, "use finite numbers, NaN for an unknown heading, or NaN in the whole row"
            )
            store(self, poses=wrap_headings(poses))
        if (self.landmark_ids is None) != (self.landmarks is None):
            raise UserError("landmarks: give landmark_ids and landmarks together, or neither")
        if self.landmark_ids is not None and self.landmarks is not None:
            landmark_ids = as_distinct_ids("landmark_ids", self.landmark_ids)
            store(
                self,
                landmark_ids=landmark_ids,
                landmarks=as_floats("landmarks", self.landmarks, (len(landmark_ids), 2)),
            )
        if self.association is not None:
            association = as_ints("association", self.association, (None,))
            known = association >= NOBODY
            if self.landmark_ids is not None:
                known &= are_among(association, self.landmark_ids) | (association == NOBODY)
            require_rows("association", known, association, "every true id must be among landmark_ids, or -1 for none")
            store(self, association=association)
        if self.outlier is not None:
            outlier = as_ints("outlier", self.outlier, (None,))
            require_rows("outlier", (outlier == 0) | (outlier == 1), outlier, "give 1 for an outlier, 0 for none")
            store(self, outlier=outlier == 1)

    @property
    def misleading(self) -> Marks | None:
        """(M,) whether each observation is clutter or an outlier; None if unknown."""
        if self.association is None:
            return self.outlier
        clutter = self.association == NOBODY
        return clutter if self.outlier is None else clutter | self.outlier


def require_same_run(truth: Truth | None, recording: Recording) -> None:
    """Refuse a truth of another length than the recording."""
    if truth is None:
        return
    for name, given, expected in (
        ("poses", truth.poses, recording.steps + 1),
        ("association", truth.association, len(recording.observation)),
        ("outlier", truth.outlier, len(recording.observation)),
    ):
        if given is not None and len(given) != expected:
            raise UserError(f"truth.{name}: {len(given)} rows, but the recording needs {expected}; give its own truth")
