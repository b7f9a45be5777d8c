"""Files in the styles of the Octave course: right ones fail no check, and seeded bugs fail their check and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.estimators.adapters import adapted
from slamgauge.compare.estimators.user_code import address
from tests.marks import in_full
from tests.reference.course_files import BUGS, STYLES, with_bug

pytestmark = pytest.mark.slow

# checks of sizes and of random recordings that take most of the time are run for one style only
REFERENCE = "dicts from 1"
QUICK = [
    check
    for check in CHECKS
    if check.name
    in (
        "truth-recovered",
        "prediction-jacobian",
        "first-sight",
        "cross-covariance",
        "innovation-wrap",
        "long-unseen",
        "update-bearing",
    )
]


def failed(source: str, name: str, folder: Path, *, is_full: bool) -> set[str]:
    """Return the names of the failed checks of a file."""
    file = folder / "mine.py"
    file.write_text(source)
    estimator, _ = adapted(address(f"{file}:{name}"))
    return {
        each.name for each in check_estimator("mine", estimator, 0, CHECKS if is_full else QUICK) if each.is_failure
    }


@pytest.mark.parametrize("name", STYLES)
def test_right_files_fail_no_check(name: str, tmp_path: Path):
    assert failed(STYLES[name].source, STYLES[name].predict, tmp_path, is_full=name == REFERENCE) == set()


@pytest.mark.parametrize("bug", BUGS)
@pytest.mark.parametrize("name", [REFERENCE, *in_full(name for name in STYLES if name != REFERENCE)])
def test_seeded_bugs_fail_their_check_and_no_other(name: str, bug: str, tmp_path: Path):
    source = with_bug(STYLES[name], bug)
    assert failed(source, STYLES[name].correct, tmp_path, is_full=name == REFERENCE) == {BUGS[bug][2]}
