"""All laws on one estimator, and the table of verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from slamgauge.compare.checks.covariance_checks import BELIEF
from slamgauge.compare.checks.exact_measurement_checks import TRUTH
from slamgauge.compare.checks.id_and_frame_checks import BOOKKEEPING
from slamgauge.compare.checks.law import Law, NotJudgedError, Subject
from slamgauge.compare.checks.new_landmark_checks import FIRST_SIGHT
from slamgauge.compare.checks.prediction_checks import PREDICTION
from slamgauge.compare.checks.step_time_check import SPEED
from slamgauge.compare.checks.update_checks import UPDATE
from slamgauge.compare.estimators.isolated_process import OverdueError
from slamgauge.compare.scoring.text_page import Grid, Page
from slamgauge.compare.scoring.text_table import cell
from slamgauge.errors import UserError
from slamgauge.estimate import Estimator

OVERDUE = "a law before this one took too long"
LAWS = (*TRUTH, *PREDICTION, *FIRST_SIGHT, *UPDATE, *BOOKKEEPING, *BELIEF, *SPEED)


@dataclass(frozen=True)
class Verdict:
    """What one law says of an estimator; its fields are the keys of the JSON.

    Attributes:
        name: of the law.
        passed: whether the law is kept; None if it could not be judged.
        figure: what was measured; None if there is none.
        bound: what it may be at most.
        blame: the part of a filter that is to blame where the law is broken; why it is not judged, where it is not.
        limit_of_method: the law is broken as the textbook method itself breaks it.
    """

    name: str
    passed: bool | None
    figure: float | None
    bound: float
    blame: str
    limit_of_method: bool = False

    @property
    def is_failure(self) -> bool:
        """Broken, and no limit of the method."""
        return self.passed is False and not self.limit_of_method


def check_estimator(name: str, estimator: Estimator, seed: int = 0, laws: Sequence[Law] = LAWS) -> list[Verdict]:
    """Hold an estimator to the laws.

    Args:
        name: what error texts call it.
        estimator: any callable `Recording -> Estimate`.
        seed: of what is drawn in the laws' recordings; each law has its own stream.
        laws: all of them, or some.

    After a law on which it is not done in time (`isolated`) the others are not judged.
    """
    subject, found, is_overdue = Subject(name, estimator), list[Verdict](), False
    for law in laws:
        if is_overdue:
            found.append(Verdict(law.name, None, None, law.bound, f"not judged: {OVERDUE}"))
            continue
        try:
            found.append(_verdict(law, subject, np.random.default_rng([seed, *law.name.encode()])))
        except OverdueError as error:
            is_overdue = True
            found.append(Verdict(law.name, False, None, law.bound, f"{error}; {law.blame}"))
    return found


def _verdict(law: Law, subject: Subject, rng: np.random.Generator) -> Verdict:
    try:
        figure = law.judge(subject, rng)
    except NotJudgedError as lacking:
        return Verdict(law.name, None, None, law.bound, f"not judged: {lacking}")
    except OverdueError:
        raise
    except UserError as error:
        return Verdict(law.name, False, None, law.bound, f"{error}; {law.blame}")
    if figure <= law.bound:
        return Verdict(law.name, True, figure, law.bound, law.blame)
    is_limit = figure <= law.excused_to
    blame = law.limit if is_limit else law.blame
    return Verdict(law.name, False, figure if np.isfinite(figure) else None, law.bound, blame, is_limit)


def verdicts_json(verdicts: Sequence[Verdict]) -> list[dict[str, object]]:
    """The verdicts as `slamgauge check --json` prints them."""
    return [asdict(verdict) for verdict in verdicts]


def verdicts_table(verdicts: Sequence[Verdict]) -> Page:
    """A line for every law; below it, what to look at for those that are not kept."""
    head = ("law", "verdict", "figure", "bound")
    rows = [(each.name, _word(each), cell(each.figure, "{:.2g}"), f"{each.bound:g}") for each in verdicts]
    said = [f"{each.name}: {each.blame}" for each in verdicts if not each.passed]
    failed = sum(each.is_failure for each in verdicts)
    summary = f"{len(verdicts)} laws, {failed} failed" if failed else f"{len(verdicts)} laws, none failed"
    return Page((Grid([head, *rows], words=2), *said, summary))


def _word(verdict: Verdict) -> str:
    if verdict.passed is None:
        return "not judged"
    return "passed" if verdict.passed else "limit" if verdict.limit_of_method else "FAILED"
