"""All checks on one estimator, and the table of verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamgauge.compare.checks import covariance_checks, mean_checks, update_checks
from slamgauge.compare.checks.check import Check, NotJudgedError, OtherModelError, Subject
from slamgauge.compare.checks.ignored_inputs import ignored_inputs
from slamgauge.compare.estimators.user_errors import OverdueError
from slamgauge.compare.scoring.table import Head, Page, Table, cell
from slamgauge.errors import CovarianceError, UserError
from slamgauge.estimate import Estimator

OVERDUE = "the estimator exceeded the time limit in an earlier check"
CHECKS = (
    *mean_checks.CHECKS,
    *covariance_checks.PREDICTION_CHECKS,
    *update_checks.CHECKS,
    *mean_checks.EQUIVALENCE_CHECKS,
    *covariance_checks.CHECKS,
)


@dataclass(frozen=True)
class Verdict:
    """Result of one check; the fields are the keys of the JSON.

    Attributes:
        name: name of the check.
        passed: whether the estimator passed, or fails only as the textbook method does; None if it was not judged.
        figure: measured value; None if it does not exist or is not finite.
        bound: largest figure that passes.
        blame: part of the filter that usually causes a failure; the reason if the check was not judged.
        limit_of_method: True if the textbook method itself fails the check in the same way.
    """

    name: str
    passed: bool | None
    figure: float | None
    bound: float
    blame: str
    limit_of_method: bool = False

    @property
    def is_failure(self) -> bool:
        """Whether the check failed."""
        return self.passed is False


def check_estimator(name: str, estimator: Estimator, seed: int = 0, checks: Sequence[Check] = CHECKS) -> list[Verdict]:
    """Return the verdicts of the checks on an estimator.

    A run on a plain recording shows the inputs that it ignores (`ignored_inputs`); checks that need one of these do not
    judge it. If it exceeds its time limit (`isolated`) in a check, the later checks are not judged. A failure that may
    follow from the failure of a check that it presupposes is not judged.

    Args:
        name: name of the estimator in error messages.
        estimator: any callable `Recording -> Estimate`.
        seed: seed of the recordings; each check has its own random stream.
        checks: all checks, or some of them.

    Raises:
        UserError: the estimator fails on the plain recording, so that no check can judge it.
    """
    ignored = ignored_inputs(Subject(name, estimator))
    found, refused, causes, is_overdue = list[Verdict](), set[str](), dict[str, str](), False
    for each in checks:
        subject = Subject(name, estimator, ignored, is_overdue=is_overdue)
        try:
            found.append(_verdict(each, subject, np.random.default_rng([seed, *each.name.encode()])))
            causes[each.name] = subject.cause
        except NotJudgedError as reason:
            found.append(Verdict(each.name, None, None, each.bound, f"not judged: {reason}"))
        except OtherModelError as model:
            found.append(Verdict(each.name, True, None, each.bound, str(model), limit_of_method=True))
        except UserError as error:
            is_overdue = isinstance(error, OverdueError)
            if isinstance(error, CovarianceError):
                refused.add(each.name)
            found.append(Verdict(each.name, False, None, each.bound, f"{error}; {each.blame}"))
    return _without_consequences(found, refused, causes)


def _verdict(check: Check, subject: Subject, rng: np.random.Generator) -> Verdict:
    lacking = next((need for need in check.needs if subject.ignores(need)), "")
    if subject.is_overdue or lacking:
        own = " and associates on its own" if lacking == "ids" else ""
        raise NotJudgedError(OVERDUE if subject.is_overdue else f"it ignores the {lacking} of the recording{own}")
    figure = check.measure(subject, rng)
    if figure <= check.bound:
        return Verdict(check.name, True, figure, check.bound, check.blame)
    if figure <= check.excused_to:
        return Verdict(check.name, True, figure, check.bound, check.limit, limit_of_method=True)
    if subject.is_confused:
        raise NotJudgedError("its own association may have confused landmarks")
    return Verdict(check.name, False, figure if np.isfinite(figure) else None, check.bound, check.blame)


def _without_consequences(verdicts: list[Verdict], refused: set[str], causes: Mapping[str, str]) -> list[Verdict]:
    """Replace failures of checks that presuppose a failed check, and invalid covariances that another failure explains.

    `refused` has the names of checks whose estimates were refused for a covariance. A wrong covariance may make the
    estimate of any recording invalid, also where only the mean is measured. If a check found its cause, another failed
    check (`causes`), the failures that presuppose it follow from that one.
    """
    failed = {each.name for each in verdicts if each.is_failure}
    direct = failed - refused or failed
    for name, cause in causes.items():
        if cause in failed:
            direct = {each for each in direct if each == cause or name not in {each} | presupposed(each)}
    roots = [each.name for each in verdicts if each.name in direct and not presupposed(each.name) & direct]
    kept: list[Verdict] = []
    for each in verdicts:
        above = [root for root in roots if each.name not in direct or root in presupposed(each.name)]
        if each.is_failure and above:
            reason = f"not judged: {above[0]} fails, and this may follow from it"
            each = replace(each, passed=None, figure=None, blame=reason)
        kept.append(each)
    return kept


def presupposed(name: str) -> set[str]:
    """Return the names of all checks that a check presupposes, directly or through others."""
    direct = next((each.after for each in CHECKS if each.name == name), ())
    return {*direct}.union(*map(presupposed, direct))


def verdicts_table(verdicts: Sequence[Verdict]) -> Page:
    """Return a table with a row per check, followed by the explanation of each check that was not passed."""
    rows = [(each.name, _word(each), cell(each.figure, "{:.2g}"), f"{each.bound:g}") for each in verdicts]
    explanations = [f"{each.name}: {each.blame}" for each in verdicts if not each.passed or each.limit_of_method]
    failed = sum(each.is_failure for each in verdicts) or "none"
    heads = [Head("check", words=True), Head("verdict", words=True), Head("figure"), Head("bound")]
    return Page((Table.of(heads, rows), *explanations, f"{len(verdicts)} checks, {failed} failed"))


def _word(verdict: Verdict) -> str:
    if verdict.passed is None:
        return "not judged"
    return "limit" if verdict.limit_of_method else "passed" if verdict.passed else "FAILED"
