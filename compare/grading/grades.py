"""What a trial is worth: passed or not, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgauge.compare.estimators.isolated_process import printable
from slamgauge.compare.grading.trial import Trial, optimum_ates
from slamgauge.compare.scoring.error_bounds import AgainstReference, against_reference, ates, late_nees
from slamgauge.compare.scoring.intervals import Interval, mean_interval, ratio_interval
from slamgauge.compare.scoring.optimum_figures import share_of_doubt
from slamgauge.compare.scoring.optimum_notes import beats_the_optimum
from slamgauge.compare.scoring.scores import Score


@dataclass(frozen=True, kw_only=True)
class Grade:
    """A submission's grade.

    Attributes:
        submission: its name.
        trial: what it did.
        reasons: why it has not passed, a line each; of one that is not graded the one reason why.
        kind: of its estimates; empty if it is not graded.
        ate_m: mean over runs.
        nees: mean over runs and steps from the 11th on of the pose NEES, over 3.
        reference: its figures over the reference's; None if it is not graded.
        ratio_to_optimum: ATE over the causal optimum's.
        seconds: median over runs.
    """

    submission: str
    trial: Trial
    reasons: tuple[str, ...]
    kind: str = ""
    ate_m: Interval | None = None
    nees: Interval | None = None
    reference: AgainstReference | None = None
    ratio_to_optimum: Interval | None = None
    seconds: float | None = None

    @property
    def is_graded(self) -> bool:
        """Whether there is anything to judge."""
        return self.trial.reason is None

    @property
    def passed(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.reasons

    @property
    def failed_laws(self) -> list[str]:
        """Names of the laws that it breaks."""
        return [verdict.name for verdict in self.trial.verdicts if verdict.is_failure]

    def to_json(self) -> dict[str, Any]:
        """The row of grades.csv: plain values, None where there is none."""
        figures = {"ate_m": self.ate_m, "nees_per_dof": self.nees, "ratio_to_optimum": self.ratio_to_optimum}
        found = self.reference
        figures |= {
            "ate_ratio": found and found.ate,
            "nees_ratio": found and found.nees,
            "sigma_position_ratio": found and found.sigma_position,
            "sigma_heading_ratio": found and found.sigma_heading,
        }
        row: dict[str, Any] = {
            "submission": self.submission,
            "passed": self.passed,
            "reason": "; ".join(self.reasons),
            "graded": self.is_graded,
            "callable": self.trial.callable,
            "form": self.trial.form,
            "kind": self.kind,
            "runs": len(self.trial.scores),
            "failed_laws": " ".join(self.failed_laws),
            "seconds_per_run": self.seconds,
        }
        for key, interval in figures.items():
            low_high = (None, None) if interval is None else (interval.low, interval.high)
            row |= {key: interval and interval.mean, f"{key}_low": low_high[0], f"{key}_high": low_high[1]}
        return row


def grade(submission: str, trial: Trial, reference: Sequence[Score]) -> Grade:
    """Judge a trial by the reference's scores of the same runs."""
    if trial.reason is not None:
        return Grade(submission=submission, trial=trial, reasons=(printable(trial.reason),))
    scores = trial.scores
    figures = against_reference(scores, reference)
    kinds = [each.kind for each in scores if each.kind != reference[0].kind]
    unlike = [f"says that its poses are {kinds[0]}; {reference[0].kind} ones are asked for"] if kinds else []
    ratio = ratio_interval(ates(scores), optimum_ates(scores))
    laws = [each.name for each in trial.verdicts if each.is_failure]
    broken = [f"breaks the law{'s' if len(laws) > 1 else ''} {', '.join(laws)}"] if laws else []
    doubt = share_of_doubt(np.array([each.yardstick_check_sigma for each in scores], dtype=np.float64))
    too_good = None if doubt else beats_the_optimum(ratio, int(np.isfinite(optimum_ates(scores)).sum()))
    return Grade(
        submission=submission,
        trial=trial,
        reasons=(*unlike, *([too_good] if too_good else []), *figures.broken, *broken),
        kind=scores[0].kind,
        ate_m=mean_interval(ates(scores)),
        nees=mean_interval(late_nees(scores)),
        reference=figures,
        ratio_to_optimum=ratio,
        seconds=float(np.median([each.seconds_total or 0.0 for each in scores])),
    )
