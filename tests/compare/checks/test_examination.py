"""The laws of `slamgauge check`: kept by every filter of ours and by the right textbook, broken by seeded bugs."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from references.seeded_bugs import SEEDED, seeded_ekf

from slamgauge import Estimate, Recording, load_estimators
from slamgauge.compare.checks import law as law_module
from slamgauge.compare.checks.examination import LAWS, Verdict, check_estimator, verdicts_json, verdicts_table
from slamgauge.compare.checks.step_time_check import SPEED
from slamgauge.compare.cli.main import main
from slamgauge.estimate import Estimator

TIMELESS = [law for law in LAWS if law.name != "step-time"]
PAGE = Path(__file__).parents[3] / "docs/checks.md"
OWN = "import sys\nsys.path.insert(0, {place!r})\nfrom references.seeded_bugs import seeded_ekf\n"
BENCHMARKS = str(Path(__file__).parents[3] / "benchmarks")


def failed(verdicts: list[Verdict]) -> set[str]:
    return {verdict.name for verdict in verdicts if verdict.is_failure}


def poses_alone(recording: Recording) -> Estimate:
    right = seeded_ekf(recording)
    return Estimate("filtered", right.poses, right.pose_covs)


LIMITS = {"ekf": {"standing-robot-in-noise"}, "iekf": {"standing-robot-in-noise"}, "riukf": {"heading-wrap"}}


@pytest.mark.parametrize(
    "name",
    ["ekf", "iekf", "fej-ekf", "oc-ekf", "riekf", "riukf", "robocentric-ekf", "sliding-window", "causal", "batch"],
)
def test_ours_pass_and_each_has_the_limits_of_its_method(name: str):
    verdicts = check_estimator(name, load_estimators([name])[name], seed=3, laws=TIMELESS)
    assert not failed(verdicts), str(verdicts_table(verdicts))
    assert {each.name for each in verdicts if each.passed is None} == ({"no-future"} if name == "batch" else set())
    limits = {each.name for each in verdicts if each.limit_of_method}
    assert limits == LIMITS.get(name, set())


def test_the_right_textbook_raises_no_false_alarm_over_20_seeds():
    for seed in range(20):
        assert not failed(check_estimator("right", seeded_ekf, seed, TIMELESS)), seed


@pytest.mark.parametrize("bug", SEEDED)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # bugs may overflow
def test_a_seeded_bug_is_caught_by_the_law_named_for_it_and_by_no_unrelated_one(bug: str):
    named, related = SEEDED[bug]
    for seed in range(3):
        broken = failed(check_estimator(bug, partial(seeded_ekf, bug=bug), seed, TIMELESS))
        assert named in broken
        assert broken <= {named, *related.split()}


def test_nearly_every_law_has_a_bug_of_its_own():
    named = {law for law, _ in SEEDED.values()}
    assert {law.name for law in LAWS} - named == {"rigid-motion", "standing-robot-in-noise", "step-time"}
    assert {name for _, related in SEEDED.values() for name in related.split()} <= {law.name for law in TIMELESS}


def test_poses_and_their_covariances_are_enough_to_be_judged():
    verdicts = {each.name: each for each in check_estimator("poses", poses_alone, laws=TIMELESS)}
    assert not failed([*verdicts.values()])
    lacking = {name: each.blame for name, each in verdicts.items() if each.passed is None}
    assert lacking == {
        "first-sight": "not judged: no landmark_covs given",
        "cross-covariance": "not judged: no landmarks given",
    }
    assert "not judged" in str(verdicts_table([*verdicts.values()]))


def test_an_estimator_that_raises_fails_that_law_with_its_message_and_the_others_go_on():
    def refuses(recording: Recording) -> Estimate:
        if not len(recording.observation):
            raise ZeroDivisionError("nothing is seen")
        return seeded_ekf(recording)

    verdicts = {each.name: each for each in check_estimator("mine", refuses, laws=TIMELESS)}
    of_prediction = {"prediction-jacobian", "odometry-noise-frame", "odometry-noise-size", "time-step"}
    assert failed([*verdicts.values()]) == {*of_prediction, "prior-respected"}
    broken = verdicts["time-step"]
    assert "ZeroDivisionError: nothing is seen" in broken.blame
    assert (broken.passed, broken.figure) == (False, None)


def test_a_landmark_that_was_seen_and_is_missing_in_the_map_is_said():
    def forgets(recording: Recording) -> Estimate:
        right = seeded_ekf(recording)
        kept = right.landmark_ids == 0
        return replace(
            right, landmark_ids=right.landmark_ids[kept], landmarks=right.landmarks[kept], landmark_covs=None
        )

    verdicts = {each.name: each for each in check_estimator("mine", forgets, laws=TIMELESS)}
    assert "landmark 1 was seen and is not in landmark_ids" in verdicts["cross-covariance"].blame


@pytest.mark.parametrize(("power", "word"), [(0, "passed"), (2, "passed"), (3, "limit"), (4, "FAILED")])
def test_the_step_time_is_judged_by_its_growth(power: int, word: str, monkeypatch: pytest.MonkeyPatch):
    clock = [0.0]
    monkeypatch.setattr(law_module, "cpu_seconds", lambda: clock[0])

    def slow(recording: Recording) -> Estimate:
        landmarks = int((recording.observation_step == 0).sum())
        clock[0] += 2e-3 * recording.steps * (landmarks / 20) ** power
        return Estimate("filtered", np.zeros((recording.steps + 1, 3)))

    (verdict,) = check_estimator("slow", slow, laws=SPEED)
    assert verdict.figure == pytest.approx(power)
    assert f"step-time  {word}" in str(verdicts_table([verdict]))


def test_the_command_prints_a_table_and_says_by_its_status_whether_a_law_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "mine.py").write_text(
        OWN.format(place=BENCHMARKS) + "def bad(recording): return seeded_ekf(recording, 'wrong sign in F')\n"
    )
    assert main(["check", f"{tmp_path}/mine.py:seeded_ekf"]) == 0
    assert capsys.readouterr().out.endswith(f"{len(LAWS)} laws, none failed\n")
    assert main(["check", f"{tmp_path}/mine.py:bad", "--json", "--seed", "4"]) == 1
    rows = json.loads(capsys.readouterr().out)
    assert [row["name"] for row in rows] == [law.name for law in LAWS]
    assert {*rows[0]} == {"name", "passed", "figure", "bound", "blame", "limit_of_method"}
    (broken,) = (row for row in rows if row["name"] == "prediction-jacobian")
    assert (broken["passed"], broken["limit_of_method"]) == (False, False)
    assert "the Jacobian F of the prediction" in broken["blame"]


@pytest.mark.parametrize("words", [["ekf", "--seed", "-1"], ["ekff"], ["no_such_file.py:estimate"]])
def test_a_users_mistake_is_one_line(words: list[str], capsys: pytest.CaptureFixture[str]):
    assert main(["check", *words]) == 2
    printed = capsys.readouterr()
    assert (printed.out, len(printed.err.splitlines())) == ("", 1)


def test_the_same_seed_gives_the_same_verdicts_and_json_without_what_json_has_not():
    estimator: Estimator = seeded_ekf
    one, two = (check_estimator("right", estimator, seed=5, laws=TIMELESS) for _ in range(2))
    assert one == two
    assert json.loads(json.dumps(verdicts_json(one), allow_nan=False)) == verdicts_json(one)


def test_the_page_names_every_law_with_its_bound_and_every_seeded_bug():
    page = PAGE.read_text(encoding="utf-8")
    assert not [law.name for law in LAWS if f"| `{law.name}` | {law.figure} | {law.bound:g} |" not in page]
    assert not [bug for bug, (named, _) in SEEDED.items() if f"\n{bug:41}{named:23}" not in page]
