"""What would take days is asked for, what memory does not hold is refused: at once, by a line that names the key."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from fields import lanes

from slamgauge import load_scenario, save, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators import cost_estimate
from slamgauge.compare.estimators.requests import ask

MANY = "100000000"
DAYS = r"^slamgauge: {key}: [^\n]+ take some [\d.e+]+ days; [^\n]+ --yes\n$"


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (("study", "q1-short-dense", "--runs", MANY), "runs"),
        (("study", "q1-short-dense", "--precision", "0.01", "--max-runs", MANY), "runs"),
        (("study", "q1-short-dense", "--runs", MANY, "--sweep", "association.gate=1,9"), "runs"),
        (("budget", "q1-short-dense", "--runs", MANY), "runs"),
        (("claims", "--runs", MANY), "runs"),
        (("grade", "examples", "--scenario", "q1-short-dense", "--runs", MANY), "runs"),
        (("bench", "--landmarks", "12000,10000"), "landmarks"),
    ],
)
def test_days_are_asked_for_before_anything_is_made(
    words: tuple[str, ...],
    key: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 1e300)
    begun = time.process_time()
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    assert time.process_time() - begun < 10.0
    assert not (tmp_path / "out").exists()
    assert _matches(DAYS.format(key=key), capsys.readouterr().err)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "q1-short-dense", "--runs", MANY, "--yes"), "runs: to sum up 100000000 of"),
        (("study", "q1-short-dense", "--runs", MANY, "--yes", "--sweep", "association.gate=1,9"), "runs: to sum up"),
        (("claims", "--runs", MANY, "--yes"), "runs: to sum up 100000000 of"),
        (("grade", "examples", "--scenario", "q1-short-dense", "--runs", MANY, "--yes"), "runs: to sum up"),
        (("budget", "q1-short-dense", "--runs", "100000000000", "--yes"), "runs: a budget of 100000000000"),
        (("bench", "--landmarks", MANY, "--yes"), "landmarks: the covariance of 100000000 needs"),
    ],
)
def test_what_memory_does_not_hold_is_refused_even_if_it_is_asked_for(
    words: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"slamgauge: {said}")
    assert error.count("\n") == 1
    assert " GB are free; " in error


def test_a_run_and_a_recording_that_take_days(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path / "r.npz", simulate("q1-short-dense", 0)[1])
    monkeypatch.setattr(cost_estimate, "DAY", 1e-3)
    for words in (["run", "q1-short-dense", "--out", str(tmp_path / "out")], ["evaluate", str(tmp_path / "r.npz")]):
        assert main([*words, "--estimators", "ekf"]) == 2
        assert _matches(DAYS.format(key="estimators"), capsys.readouterr().err)
    assert main(["evaluate", str(tmp_path / "r.npz"), "--estimators", "dead-reckoning", "--yes"]) == 0


def test_a_run_that_takes_hours_says_so_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cost_estimate, "LONG", 1e-3)
    monkeypatch.setattr(cost_estimate, "tell_once", cost_estimate.tell_once.__wrapped__)  # whatever was told before
    run = ["run", "q1-short-dense", "--set", "trajectory.duration=3", "--no-report", "--out", str(tmp_path / "out")]
    assert main([*run, "--estimators", "dead-reckoning"]) == 0
    said = r"slamgauge: estimators: 1 of 30 steps and \d+ landmarks take some 0.0 h; give fewer, or a shorter run, for "
    assert re.match(said, capsys.readouterr().err)


def test_the_hindsight_optimum_of_a_map_seen_a_part_at_a_time_is_not_said_to_be_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By landmarks and steps alone it would take as long as a filter whose covariance is dense."""
    recording = lanes(lanes=16, length=60)
    at_once = cost_estimate.seconds_for(recording, ask(["batch"])[0])
    monkeypatch.setattr(cost_estimate, "LONG", 1.0)
    pieces, full = (cost_estimate.seconds_for(recording, ask([name])[0]) for name in ("batch", "ekf"))
    assert at_once > full > 20.0
    assert 0.3 < pieces < 5.0  # it takes some 2 s


def test_estimates_that_memory_does_not_hold_are_refused_before_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording of 628 steps, and room for the estimates of one filter, not for those of three."""
    save(tmp_path / "r.npz", simulate("q1-short-dense", 0)[1])
    evaluate = ["evaluate", str(tmp_path / "r.npz"), "--yes", "--estimators"]
    monkeypatch.setattr("slamgauge.compare.storage.npz_file.COPIES", 0.0)  # it is read
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e5)
    assert main([*evaluate, "ekf,riekf,fej-ekf"]) == 2
    said = (
        r"slamgauge: estimators: 3 of 628 steps: what they estimate needs 0.0 GB of memory, [^\n]*; give fewer[^\n]*\n"
    )
    assert _matches(said, capsys.readouterr().err)
    assert main([*evaluate, "dead-reckoning"]) == 0


def test_a_run_that_memory_does_not_hold_is_refused_by_its_steps_or_its_sights(monkeypatch: pytest.MonkeyPatch) -> None:
    for free, said in ((1e4, "a run of 628 steps among"), (4e5, r"a run of \d{4} observations")):
        monkeypatch.setattr("slamgauge.memory.free_memory", lambda free=free: free)
        with pytest.raises(ValueError, match=rf"^{said} [^\n]*needs 0.0 GB of memory.*; shorten trajectory.duration"):
            simulate("q1-short-dense", 0)


def test_a_map_size_of_thousands_of_digits_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--landmarks", "1" * 5000]) == 2
    assert _matches(r"slamgauge: landmarks '1+: give map sizes > 0, for example 20,100\n", capsys.readouterr().err)


def test_what_is_usual_is_never_asked_for() -> None:
    scenario = load_scenario("q1-long-dense")
    cost_estimate.require_time_for_runs(1000, [(scenario, ask(["ekf", "riekf", "causal"]))], 1, agreed=False)
    cost_estimate.require_room_for_runs(1000, scenario, 3)


def _matches(pattern: str, text: str) -> bool:
    return re.fullmatch(pattern, text) is not None


@pytest.mark.parametrize("jobs", ["0", "1025", str(2**64)])
def test_more_processes_than_machines_have_are_a_line(
    jobs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("study", "q1-short-dense", "--runs", "1", "--estimators", "dead-reckoning", "--jobs", jobs)
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    told = f"jobs: {jobs} processes carry nothing, or the machine does not; give 1 to 1024"
    assert capsys.readouterr().err == f"slamgauge: {told}\n"
