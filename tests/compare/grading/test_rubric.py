"""Points by a rubric: partial credit, items that are not judged, and mistakes in rubric files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from slamgauge.compare.checks.examination import CHECKS, Verdict
from slamgauge.compare.grading.rubric import DEFAULT_TEXT, Mark, load_rubric
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

RUBRIC = load_rubric()
PASSED = [Verdict(each.name, True, 0.0, each.bound, each.blame) for each in CHECKS]


def mark(
    ate: float = 1.0, nees: float | None = 1.0, other: float = 1.0, verdicts: list[Verdict] = PASSED, broken: str = ""
) -> Mark:
    own = None if nees is None else Interval(nees, None, None)
    return RUBRIC.mark(Interval(ate, None, None), own, Interval(other, None, None), verdicts, broken)


def points_of(found: Mark) -> dict[str, tuple[float, float]]:
    return {each.name: (round(each.points, 3), round(each.most, 3)) for each in found.items if each.is_judged}


def test_the_default_rubric_weighs_every_check_is_on_the_page_and_gives_a_right_filter_all_points():
    assert {*RUBRIC.checks} == {each.name for each in CHECKS}
    assert sum(RUBRIC.checks.values()) + RUBRIC.accuracy.weight + RUBRIC.consistency.weight == RUBRIC.total == 100
    assert mark().points == 100
    assert points_of(mark())["truth-recovered"] == (6.0, 6.0)
    assert not {"standing-robot-in-noise", "standing-robot"} & {*points_of(mark())}  # their weight is 0
    omitted = {each.name for each in CHECKS} - {each.name for each in RUBRIC.needed_checks}
    assert omitted == {"standing-robot-in-noise"}  # a weighted check presupposes the other
    page = (Path(__file__).parents[3] / "docs/grading.md").read_text(encoding="utf-8")
    assert f"```toml\n{DEFAULT_TEXT}```\n" in page


@pytest.mark.parametrize(
    ("ate", "nees", "other", "accuracy", "consistency"),
    [
        (0.9, 3.0, 3.0, 25.0, 25.0),
        (1.05, 1.0, 3.0, 25.0, 25.0),  # NEES better than that of the reference
        (1.525, 9.3, 3.0, 12.5, 12.5),
        (1.99, 3.1, 0.9, 0.263, 12.5),  # the reference is consistent
        (2.0, 1 / 3.1, 1.0, 0.0, 12.5),  # too cautious
        (40.0, 0.3, 0.3, 0.0, 25.0),  # just as cautious as the reference
        (1.0, float("inf"), 1.0, 25.0, 0.0),
        (1.0, None, 1.0, 25.0, 0.0),
    ],
)
def test_accuracy_and_consistency_relative_to_the_reference_have_partial_credit(
    ate: float, nees: float | None, other: float, accuracy: float, consistency: float
):
    found = points_of(mark(ate=ate, nees=nees, other=other))
    assert found["accuracy"] == (pytest.approx(accuracy, abs=1e-3), 25.0)
    assert found["consistency"] == (pytest.approx(consistency, abs=1e-3), 25.0)


def test_checks_that_do_not_judge_leave_their_points_to_the_others_and_limits_of_the_method_have_all():
    half = [each if RUBRIC.checks[each.name] != 6.0 else replace(each, passed=None) for each in PASSED]
    found = mark(verdicts=half)
    assert found.points == 100
    assert points_of(found)["accuracy"] == (pytest.approx(25 * 100 / 82, abs=1e-3),) * 2
    unjudged = ["truth-recovered", "prediction-jacobian", "cross-covariance"]
    assert [each.name for each in found.items if not each.is_judged] == unjudged
    assert points_of(mark(ate=3.0, verdicts=[])) == {"accuracy": (0.0, 50.0), "consistency": (50.0, 50.0)}
    changed = [replace(each, passed=each.name != "first-sight", limit_of_method=True) for each in PASSED]
    found = mark(verdicts=changed)
    assert (found.points, points_of(found)["first-sight"]) == (96.0, (0.0, 4.0))
    assert (RUBRIC.nothing("crashed").points, RUBRIC.nothing("crashed").items[0].text) == (0.0, "crashed")
    assert mark(broken="its poses are smoothed").points == 50.0  # only those of checks


def test_a_file_replaces_only_the_keys_that_it_has_and_the_used_rubric_is_a_file(tmp_path: Path):
    path = tmp_path / "rubric.toml"
    path.write_text("total = 20\n[accuracy]\nzero = 3.0\n[checks]\ntime-step = 5\n")
    found = load_rubric(path)
    assert (found.total, found.accuracy.full, found.accuracy.zero) == (20.0, 1.05, 3.0)
    assert found.checks == {**RUBRIC.checks, "time-step": 5.0}
    path.write_text(found.to_toml())
    assert load_rubric(path) == found


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("totl = 3", "totl: unknown section; did you mean total?"),
        ("[accuracy]\nfull = 1.1\nweigth = 3", "accuracy.weigth: unknown key; did you mean weight?"),
        ("[checks]\ntime-step = -1", "checks.time-step: input should be greater than or equal to 0, not '-1'"),
        ("total = nan", "total: input should be a finite number, not 'nan'; correct it"),
        ("[consistency]\nzero = 1.2", "consistency: full = 1.2 and zero = 1.2; give ratios 1 <= full < zero"),
        ("[accuracy]\nweight = 0\n[consistency]\nweight = 0", "some submissions could have no points at all"),
    ],
)
def test_mistakes_in_a_rubric_are_one_line(tmp_path: Path, text: str, message: str):
    path = tmp_path / "rubric.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load_rubric(path)
    assert str(caught.value).startswith(f"{path}: ") and message in str(caught.value) and "\n" not in str(caught.value)
