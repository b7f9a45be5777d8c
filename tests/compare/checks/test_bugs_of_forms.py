"""A seeded bug in any form of user code fails the check that is named for it, and no other.

Other forms are tested where they are described: the exercise's columns in `test_wild_steps`, the classes of NTNU and of
online courses in `test_classes`, more styles of the Octave course in `test_course_files`.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from references.class_files import BUGS as EVERYWHERE
from references.class_files import FORMS, submissions

from slamgauge.compare.checks.examination import CHECKS, check_estimator
from slamgauge.compare.estimators.adapters import adapted, found_in
from slamgauge.compare.estimators.user_code import address
from tests.reference.wild_steps import BUGS, OWN_ASSOCIATION, ROBOTICS

pytestmark = pytest.mark.slow

# the check that is named for a bug, then checks that fail as well unless they presuppose it
OF_F = ("prediction-jacobian", "rigid-motion")
OF_H = ("update-bearing", "first-sight", "scan-order", "long-unseen", "standing-robot")
OF_WRAP = ("innovation-wrap", "heading-wrap")
OF_CROSS = ("cross-covariance", "standing-robot")
OF_RANGE = ("update-range", "first-sight", "standing-robot")
OF_BEARING = ("update-bearing", "update-range", "innovation-wrap")
OF_NEW = ("first-sight", "update-range", "measurement-noise", "long-unseen", "sound-covariances")
OF_P = ("sound-covariances", "update-range", "measurement-noise", "long-unseen")
MADE_UP = submissions()
IN_NEAREST = (  # without the wrap in the association alone
    "        e, S, _ = innovation(x, P, yi, j)\n",
    "        S, e = innovation(x, P, yi, j)[1], yi[0:2].reshape(2, 1) - see(x, j)[0]\n",
)
IN_UPDATE = (
    "e, S, _ = innovation(eta, P, j, value, R)",
    "S, e = innovation(eta, P, j, value, R)[1], value - expected(eta, j)[0]",
)


def edited(source: str, change: tuple[str, str]) -> str:
    """Return the source with its only occurrence of a text replaced."""
    old, new = change
    assert source.count(old) == 1
    return source.replace(old, new)


CASES = {
    **{
        f"{form}: {bug}": (MADE_UP[form, bug], checks)
        for form in FORMS
        for bug, checks in (("sign in F", OF_F), ("sign in H", OF_H), ("no wrap", OF_WRAP))
    },
    **{
        f"PythonRobotics: {bug}": (edited(ROBOTICS, BUGS[bug]), checks)
        for bug, checks in (("sign", OF_F), ("wrap", OF_WRAP), ("cross", OF_CROSS))
    },
    "PythonRobotics: covariance of new landmarks": (
        edited(ROBOTICS, ("Jr @ P[0:3, 0:3] @ Jr.T + Jy @ R @ Jy.T", "np.eye(2)")),
        OF_NEW,
    ),
    "estimate(recording): sign of dy in H": (
        edited(MADE_UP["estimate(recording)", "right"], ("[[dx / r, dy / r],", "[[dx / r, -dy / r],")),
        OF_RANGE,
    ),
    "estimate(recording): dx and dy of a bearing exchanged": (
        edited(
            MADE_UP["estimate(recording)", "right"], ("[dy / r**2, -dx / r**2, -1.0]", "[dx / r**2, -dy / r**2, -1.0]")
        ),
        OF_BEARING,
    ),
    "estimate(recording): half gain in P": (MADE_UP["estimate(recording)", "half gain in P"], OF_P),
    "step function: no wrap in its association": (edited(OWN_ASSOCIATION, IN_NEAREST), OF_WRAP),
    "predict and update: no wrap in its association": (
        edited(MADE_UP["predict and update", "right"], IN_UPDATE),
        OF_WRAP,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bug_fails_its_check_and_no_other(case: str, tmp_path: Path):
    source, concerned = CASES[case]
    assert failed(source, concerned, tmp_path) == {concerned[0]}


@pytest.mark.parametrize("source", [*(MADE_UP[form, "right"] for form in FORMS), ROBOTICS, OWN_ASSOCIATION])
def test_a_right_file_fails_none_of_these_checks(source: str, tmp_path: Path):
    assert failed(source, (*OF_F, *OF_H, *OF_WRAP, *OF_CROSS), tmp_path) == set()


def test_the_size_of_noise_that_only_the_file_has_is_not_judged(tmp_path: Path):
    """R is only in the file: twice as large, it is as right as before."""
    file = tmp_path / "mine.py"
    file.write_text(edited(MADE_UP["Octave course", "right"], EVERYWHERE["R twice"]))
    (check,) = (each for each in CHECKS if each.name == "measurement-noise")
    estimator, _ = adapted(found_in(address(str(file))))
    (verdict,) = check_estimator("mine", estimator, checks=[check])
    assert verdict.passed is None
    assert verdict.blame == "not judged: it ignores the observation noise of the recording"


def failed(source: str, concerned: tuple[str, ...], folder: Path) -> set[str]:
    """Return which of the checks concerned fail for a file."""
    file = folder / "mine.py"
    file.write_text(source)
    estimator, _ = adapted(found_in(address(str(file))))
    checks = [each for each in CHECKS if each.name in concerned]
    return {each.name for each in check_estimator("mine", estimator, checks=checks) if each.is_failure}
