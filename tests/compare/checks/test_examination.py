"""`slamgauge check`: right filters pass every check, and each seeded bug fails its check and no other."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from slamgauge import Estimate, Recording, load_estimators
from slamgauge.compare.checks.examination import CHECKS, Verdict, check_estimator, presupposed, verdicts_table
from slamgauge.compare.cli.main import main
from slamgauge.estimate import Estimator
from tests.marks import in_full
from tests.reference.seeded_bugs import SEEDED, seeded_ekf

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::RuntimeWarning")]  # bugs may overflow

ROOT = Path(__file__).parents[3]
LIMITS = {"ekf": {"standing-robot-in-noise"}, "iekf": {"standing-robot-in-noise"}}


def verdicts_of(estimator: Estimator, seed: int = 0) -> dict[str, Verdict]:
    return {each.name: each for each in check_estimator("mine", estimator, seed, CHECKS)}


def failed(verdicts: dict[str, Verdict]) -> set[str]:
    return {name for name, verdict in verdicts.items() if verdict.is_failure}


@pytest.mark.parametrize("name", ["ekf", "iekf", "fej-ekf", "oc-ekf", "riekf", "causal", "batch"])
def test_own_estimators_pass_except_for_the_limits_of_their_method(name: str):
    verdicts = verdicts_of(load_estimators([name])[name], seed=3)
    assert not failed(verdicts), str(verdicts_table([*verdicts.values()]))
    not_judged = {each.name for each in verdicts.values() if each.passed is None}
    assert not_judged == ({"no-future"} if name == "batch" else set())
    assert {each.name for each in verdicts.values() if each.limit_of_method} == LIMITS.get(name, set())


@pytest.mark.parametrize("bug", ["", *SEEDED])
@pytest.mark.parametrize("seed", [0, *in_full(range(1, 5))])
def test_a_right_textbook_filter_passes_and_a_seeded_bug_fails_its_check_and_no_other(seed: int, bug: str):
    assert failed(verdicts_of(partial(seeded_ekf, bug=bug), seed)) == ({SEEDED[bug]} if bug else set())


def test_checks_have_bugs_of_their_own_presuppose_others_and_never_each_other_and_are_on_the_page():
    names = {check.name for check in CHECKS}
    assert names - {*SEEDED.values()} == {"rigid-motion", "standing-robot-in-noise"}
    page = (ROOT / "docs/your_filter.md").read_text(encoding="utf-8")
    for check in CHECKS:
        assert presupposed(check.name) <= names - {check.name}
        above = ", ".join(f"`{name}`" for name in check.after) or "-"
        assert f"| `{check.name}` | {check.figure} | {check.bound:g} | {above} |\n" in page
    table = page.split("| check | needs |\n|---|---|\n")[1].split("\n\n")[0]
    rows = [line.strip("| ").replace("`", "").split(" | ") for line in table.splitlines()]
    needs = {name: needed for several, needed in rows for name in several.split(", ")}
    assert needs == {each.name: ", ".join(each.needs) for each in CHECKS if each.needs}


def test_a_failure_that_may_follow_from_another_is_not_judged_and_passes_are_kept():
    wrong = partial(seeded_ekf, bug="wrong sign in F")
    alone = check_estimator("mine", wrong, checks=[check for check in CHECKS if check.name == "rigid-motion"])
    every = verdicts_of(wrong)
    assert alone[0].is_failure
    found = every["rigid-motion"]
    assert (found.passed, found.figure) == (None, None)
    assert found.blame == "not judged: prediction-jacobian fails, and this may follow from it"
    assert [each.name for each in every.values() if not each.passed] == ["prediction-jacobian", "rigid-motion"]


def test_poses_and_their_covariances_suffice_for_all_checks_but_two():
    def poses_only(recording: Recording) -> Estimate:
        right = seeded_ekf(recording)
        return Estimate("filtered", right.poses, right.pose_covs)

    verdicts = verdicts_of(poses_only)
    assert not failed(verdicts)
    assert {name: each.blame for name, each in verdicts.items() if each.passed is None} == {
        "first-sight": "not judged: the estimate has no landmark_covs",
        "cross-covariance": "not judged: the estimate has no landmarks",
    }


def test_an_estimator_that_raises_or_forgets_a_landmark_fails_the_check_with_the_reason_and_other_checks_run():
    def refuses(recording: Recording) -> Estimate:
        if not len(recording.observation):
            raise ZeroDivisionError("no observations")
        return seeded_ekf(recording)

    def forgets(recording: Recording) -> Estimate:
        right = seeded_ekf(recording)
        kept = np.flatnonzero(right.landmark_ids == 0)
        return replace(right, landmark_ids=kept, landmarks=right.landmarks[kept], landmark_covs=None)

    verdicts = verdicts_of(refuses)
    assert failed(verdicts) == {"prior-respected", "odometry-noise-size"}
    assert "ZeroDivisionError: no observations" in verdicts["odometry-noise-size"].blame
    assert verdicts["odometry-noise-size"].figure is None
    blame = verdicts_of(forgets)["truth-recovered"].blame
    assert "landmark 1 was observed, but is not in landmark_ids" in blame


def test_the_command_prints_a_table_and_exits_with_1_if_a_check_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "mine.py").write_text(
        f"import sys\nsys.path.insert(0, {str(ROOT)!r})\nfrom tests.reference.seeded_bugs import seeded_ekf\n"
        "def bad(recording): return seeded_ekf(recording, 'wrong sign in F')\n"
    )
    assert main(["check", f"{tmp_path}/mine.py:seeded_ekf"]) == 0
    assert capsys.readouterr().out.endswith(f"{len(CHECKS)} checks, none failed\n")
    printed: list[str] = []
    for _ in range(2):
        assert main(["check", f"{tmp_path}/mine.py:bad", "--json", "--seed", "4"]) == 1
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]  # the seed determines the verdicts
    rows = json.loads(printed[0])
    assert [row["name"] for row in rows] == [check.name for check in CHECKS]
    (broken,) = (row for row in rows if row["name"] == "prediction-jacobian")
    assert {*broken} == {"name", "passed", "figure", "bound", "blame", "limit_of_method"}
    assert (broken["passed"], broken["limit_of_method"]) == (False, False)
    assert "the Jacobian F of the prediction" in broken["blame"]
