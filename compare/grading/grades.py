"""Grade of a trial: passed or not, the reasons, and points."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamgauge.compare.estimators.answers import printable
from slamgauge.compare.grading.rubric import Mark, Rubric
from slamgauge.compare.grading.trial import Trial, optimum_ates
from slamgauge.compare.scoring.error_bounds import AgainstReference, against_reference, ates, late_nees
from slamgauge.compare.scoring.intervals import Interval, mean_interval, number, ratio_interval
from slamgauge.compare.scoring.optimum_notes import beats_the_optimum
from slamgauge.compare.scoring.runs import share_of_doubt
from slamgauge.compare.scoring.scores import Score


@dataclass(frozen=True, kw_only=True)
class Grade:
    """Grade of a submission.

    Attributes:
        submission: name of the submission.
        trial: its runs.
        reasons: why it has not passed, or the one reason why it is not graded.
        mark: its points.
        remarks: remarks for the teacher, without effect on the grade.
        kind: kind of its estimates; empty if it is not graded.
        ate_m: mean over runs.
        nees: pose NEES / 3, mean over runs and over steps from the 11th on.
        reference: ratios to the reference; None if it is not graded.
        ratio_to_optimum: ATE divided by that of the causal optimum.
        own_noise: ratios to the reference with the noise of the file; None if it is that of the recording.
        seconds: median over runs.
    """

    submission: str
    trial: Trial
    reasons: tuple[str, ...]
    mark: Mark
    remarks: tuple[str, ...] = ()
    kind: str = ""
    ate_m: Interval | None = None
    nees: Interval | None = None
    reference: AgainstReference | None = None
    ratio_to_optimum: Interval | None = None
    own_noise: AgainstReference | None = None
    seconds: float | None = None

    @property
    def is_graded(self) -> bool:
        """Whether all its runs were scored."""
        return self.trial.reason is None

    @property
    def passed(self) -> bool:
        """Whether it fails no criterion."""
        return not self.reasons

    @property
    def failed_checks(self) -> list[str]:
        """Names of the failed checks."""
        return [verdict.name for verdict in self.trial.verdicts if verdict.is_failure]

    def to_json(self) -> dict[str, Any]:
        """Return the row of grades.csv; missing values and values that are not finite become None."""
        found, own = self.reference, self.own_noise
        figures = {
            "ate_m": self.ate_m,
            "nees_per_dof": self.nees,
            "ratio_to_optimum": self.ratio_to_optimum,
            "ate_ratio": found and found.ate,
            "nees_ratio": found and found.nees,
            "sigma_position_ratio": found and found.sigma_position,
            "sigma_heading_ratio": found and found.sigma_heading,
            "own_noise_ate_ratio": own and own.ate,
            "own_noise_nees_ratio": own and own.nees,
        }
        row: dict[str, Any] = {
            "submission": self.submission,
            "passed": self.passed,
            "reason": "; ".join(self.reasons),
            "points": self.mark.points,
            "max_points": self.mark.total,
            "remarks": "; ".join(self.remarks),
            "graded": self.is_graded,
            "callable": self.trial.callable,
            "form": self.trial.form,
            "settings": "; ".join(self.trial.settings),
            "kind": self.kind,
            "runs": len(self.trial.scores),
            "failed_checks": " ".join(self.failed_checks),
            "seconds_per_run": self.seconds,
        }
        for key, interval in figures.items():
            for part, end in (("mean", ""), ("low", "_low"), ("high", "_high")):
                value: float | None = getattr(interval, part, None)
                row[f"{key}{end}"] = None if value is None else number(value)
        return row


def grade(submission: str, trial: Trial, reference: Sequence[Score], rubric: Rubric) -> Grade:
    """Grade a trial by comparison with the scores of the reference on the same runs, with points by the rubric."""
    if trial.reason is not None:
        reason = printable(trial.reason)
        mark = rubric.nothing(reason)
        return Grade(submission=submission, trial=trial, reasons=(reason,), mark=mark)
    scores = trial.scores
    ratios = against_reference(scores, reference)
    ratio = ratio_interval(ates(scores), optimum_ates(scores))
    reasons: list[str] = []
    kinds = [each["kind"] for each in scores if each["kind"] != reference[0]["kind"]]
    if kinds:
        required = reference[0]["kind"]
        reasons.append(f"its poses are {kinds[0]}; {required} poses are required")
    is_in_doubt = share_of_doubt(np.array([each["yardstick_check_sigma"] for each in scores], dtype=np.float64))
    too_good = None if is_in_doubt else beats_the_optimum(ratio, int(np.isfinite(optimum_ates(scores)).sum()))
    if too_good:
        reasons.append(too_good)
    reasons += ratios.broken
    failed = [each.name for each in trial.verdicts if each.is_failure]
    if failed:
        reasons.append(f"fails the check{'s' if len(failed) > 1 else ''} {', '.join(failed)}")
    nees, other = (mean_interval(late_nees(each)) for each in (scores, reference))
    return Grade(
        submission=submission,
        trial=trial,
        reasons=tuple(reasons),
        mark=rubric.mark(ratios.ate, nees, other, trial.verdicts, reasons[0] if kinds else ""),
        kind=scores[0]["kind"],
        ate_m=mean_interval(ates(scores)),
        nees=nees,
        reference=ratios,
        ratio_to_optimum=ratio,
        own_noise=against_reference(trial.own_noise, reference) if trial.own_noise else None,
        seconds=float(np.median([each["seconds_total"] or 0.0 for each in scores])),
    )


def figure_remarks(runs: Mapping[str, Sequence[Score]], reference: str) -> dict[str, list[str]]:
    """Return remarks on submissions whose errors are identical, to the last bit, in every run.

    Args:
        runs: scores of each run, by name of the submission, and those of the reference by its name.
        reference: name of the reference.
    """
    alike: dict[tuple[float | None, ...], list[str]] = defaultdict(list)
    for name, scores in runs.items():
        if scores:
            alike[tuple(each["ate_m"] for each in scores)].append(name)
    remarks: dict[str, list[str]] = {}
    for names in alike.values():
        for name in names:
            others = [f"the reference {each}" if each == reference else each for each in names if each != name]
            if others:
                remarks[name] = [f"same figures as {', '.join(others)}"]
    return remarks
