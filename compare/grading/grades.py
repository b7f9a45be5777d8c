"""Grade of a trial: passed or not, the reasons, and points."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slamgauge.compare.estimators.answers import printable
from slamgauge.compare.grading.rubric import Mark, Rubric
from slamgauge.compare.grading.trial import Trial, optimum_ates
from slamgauge.compare.scoring.error_bounds import against_reference, ates, late_nees
from slamgauge.compare.scoring.intervals import Interval, mean_interval, number, ratio_interval
from slamgauge.compare.scoring.optimum_notes import beats_the_optimum, share_of_doubt
from slamgauge.compare.scoring.scores import Score
from slamgauge.compare.scoring.table import Head

TWO = "{:.2f}"
FIGURES = (
    Head("ATE [m]", help="RMS position error, mean over runs", key="ate_m"),
    Head("ATE x", "ATE x reference", "ATE over the reference's on the same runs", key="ate_ratio"),
    Head(
        "NEES/3", help="pose NEES / 3 from the 11th step on: 1 if the covariance is right", key="nees_per_dof", form=TWO
    ),
    Head("NEES x", "NEES x reference", "NEES over the reference's", key="nees_ratio", form=TWO),
    Head("sigma x", "sigma x reference", "position sigma over the reference's", key="sigma_position_ratio", form=TWO),
    Head("heading x", "heading sigma x reference", "the same for the heading", key="sigma_heading_ratio", form=TWO),
    Head("x causal", "ATE x causal", "ATE over that of the causal optimum", key="ratio_to_optimum", form=TWO),
    Head("ATE x, own noise", help="ATE x reference with the noise of the file", key="own_noise_ate_ratio"),
    Head("NEES x, own noise", help="NEES x reference with that noise", key="own_noise_nees_ratio", form=TWO),
)


@dataclass(frozen=True, kw_only=True)
class Grade:
    """Grade of a submission."""

    submission: str  # its name
    trial: Trial
    reasons: tuple[str, ...]  # why it has not passed, or the one reason why it is not graded
    mark: Mark
    remarks: tuple[str, ...] = ()  # for the teacher, without effect on the grade
    kind: str = ""  # kind of its estimates; empty if it is not graded
    figures: Mapping[str, Interval | None] = field(default_factory=dict)  # the keys are those of `FIGURES`
    seconds: float | None = None  # median over runs

    @property
    def is_graded(self) -> bool:
        """Whether all its runs were scored."""
        return self.trial.reason is None

    @property
    def passed(self) -> bool:
        """Whether it fails no criterion."""
        return not self.reasons

    def to_json(self) -> dict[str, Any]:
        """Return the row of grades.csv; missing values and values that are not finite become None."""
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
            "failed_checks": " ".join(self.trial.failed_checks),
            "seconds_per_run": self.seconds,
        }
        for head in FIGURES:
            interval = self.figures.get(head.key)
            for part, end in (("mean", ""), ("low", "_low"), ("high", "_high")):
                value: float | None = getattr(interval, part, None)
                row[f"{head.key}{end}"] = None if value is None else number(value)
        return row


def grade(submission: str, trial: Trial, reference: Sequence[Score], rubric: Rubric) -> Grade:
    """Grade a trial by comparison with the scores of the reference on the same runs, with points by the rubric."""
    if trial.reason is not None:
        reason = printable(trial.reason)
        return Grade(submission=submission, trial=trial, reasons=(reason,), mark=rubric.nothing(reason))
    scores = trial.scores
    ratios, broken = against_reference(scores, reference)
    ratio = ratio_interval(ates(scores), optimum_ates(scores))
    reasons: list[str] = []
    required = reference[0]["kind"]
    kinds = [each["kind"] for each in scores if each["kind"] != required]
    if kinds:
        reasons.append(f"its poses are {kinds[0]}; {required} poses are required")
    is_in_doubt = share_of_doubt(np.array([each["yardstick_check_sigma"] for each in scores], dtype=np.float64))
    too_good = None if is_in_doubt else beats_the_optimum(ratio, int(np.isfinite(optimum_ates(scores)).sum()))
    reasons += [*filter(None, [too_good]), *broken]
    failed = trial.failed_checks
    if failed:
        reasons.append(f"fails the check{'s' if len(failed) > 1 else ''} {', '.join(failed)}")
    nees, other = (mean_interval(late_nees(each)) for each in (scores, reference))
    figures = {
        "ate_m": mean_interval(ates(scores)),
        "nees_per_dof": nees,
        "ratio_to_optimum": ratio,
        **ratios,
    }
    if trial.own_noise:
        own, _ = against_reference(trial.own_noise, reference)
        figures |= {f"own_noise_{key}": own[key] for key in ("ate_ratio", "nees_ratio")}
    return Grade(
        submission=submission,
        trial=trial,
        reasons=tuple(reasons),
        mark=rubric.mark(ratios["ate_ratio"], nees, other, trial.verdicts, reasons[0] if kinds else ""),
        kind=scores[0]["kind"],
        figures=figures,
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
