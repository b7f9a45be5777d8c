"""Requests that do not fit into memory are refused before any work begins, by a line that names the key to change."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from slamgauge import load_scenario, save, simulate
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.memory_check import require_room_for_runs

MANY = "100000000"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "q1-short-dense", "--runs", MANY), "runs: to sum up 100000000 of"),
        (("study", "q1-short-dense", "--precision", "0.01", "--max-runs", MANY), "runs: to sum up 100000000 of"),
        (("study", "q1-short-dense", "--runs", MANY, "--sweep", "association.gate=1,9"), "runs: to sum up"),
        (("claims", "--runs", MANY), "runs: to sum up 100000000 of"),
        (("grade", "examples", "--scenario", "q1-short-dense", "--runs", MANY), "runs: to sum up"),
        (("budget", "q1-short-dense", "--runs", "100000000000"), "runs: a budget of 100000000000"),
        (("bench", "--landmarks", MANY), "landmarks: the covariance of 100000000 needs"),
    ],
)
def test_what_does_not_fit_into_memory_is_refused(
    words: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"slamgauge: {said}")
    assert error.count("\n") == 1
    assert " GB are free; " in error


def test_estimates_that_do_not_fit_into_memory_are_refused_before_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording of 628 steps, with memory for the estimates of one filter, not for those of three."""
    save(tmp_path / "r.npz", simulate("q1-short-dense", 0)[1])
    evaluate = ["evaluate", str(tmp_path / "r.npz"), "--estimators"]
    monkeypatch.setattr("slamgauge.compare.storage.npz_file.COPIES", 0.0)  # the recording can be read
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e5)
    assert main([*evaluate, "ekf,riekf,fej-ekf"]) == 2
    said = (
        r"slamgauge: estimators: 3 of 628 steps: what they estimate needs 0.0 GB of memory, [^\n]*; give fewer[^\n]*\n"
    )
    assert re.fullmatch(said, capsys.readouterr().err)
    assert main([*evaluate, "dead-reckoning"]) == 0


def test_a_run_that_does_not_fit_is_refused_by_its_steps_or_observations(monkeypatch: pytest.MonkeyPatch) -> None:
    for free, said in ((1e4, "a run of 628 steps among"), (4e5, r"a run of \d{4} observations")):
        monkeypatch.setattr("slamgauge.memory.free_memory", lambda free=free: free)
        with pytest.raises(ValueError, match=rf"^{said} [^\n]*needs 0.0 GB of memory.*; shorten trajectory.duration"):
            simulate("q1-short-dense", 0)


def test_a_map_size_of_thousands_of_digits_is_refused_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--landmarks", "1" * 5000]) == 2
    said = r"slamgauge: landmarks '1+: give map sizes > 0, for example 20,100\n"
    assert re.fullmatch(said, capsys.readouterr().err)


def test_a_usual_study_is_not_refused() -> None:
    require_room_for_runs(1000, load_scenario("q1-long-dense"), 3)


@pytest.mark.parametrize("jobs", ["0", "1025", str(2**64)])
def test_a_number_of_processes_out_of_range_is_refused_in_a_line(
    jobs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("study", "q1-short-dense", "--runs", "1", "--estimators", "dead-reckoning", "--jobs", jobs)
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    told = f"jobs: {jobs} is out of range; give 1 to 1024"
    assert capsys.readouterr().err == f"slamgauge: {told}\n"
