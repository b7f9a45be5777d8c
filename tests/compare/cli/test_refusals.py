"""Mistakes of users, defects and refusals of the machine: one line on standard error, an exit status, no results."""

from __future__ import annotations

import errno
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest

import slamgauge
from slamgauge import load_scenario, simulate
from slamgauge.compare.cli.main import REFUSED
from slamgauge.compare.estimators.running import require_room_for_runs
from slamgauge.compare.storage.files import save
from slamgauge.errors import refused_by_the_machine
from tests.reference.command_line import command_after, contents, run

pytestmark = pytest.mark.slow

MANY = "100000000"
Mistake = Callable[..., str]


@pytest.fixture
def mistake(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Mistake:
    """Runs a command that ends with a status and writes nothing, and returns its lines on standard error."""
    monkeypatch.chdir(tmp_path)

    def lines(*arguments: object, status: int = 2) -> str:
        before = contents(tmp_path)
        assert run(*arguments) == status
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("slamgauge: ")
        assert contents(tmp_path) == before
        return printed.err.removeprefix("slamgauge: ").removesuffix("\n")

    return lines


COMMANDS = {  # words of a command, without blanks inside, and the begin of its line
    "rnu": "rnu: no such command; did you mean run?",
    "": "no command is given; use one of exercise, scenarios, run, ",
    "run": "words are missing: `slamgauge run` needs scenario and a value behind each option; see",
    "grade x": "words are missing: `slamgauge grade` needs folder and scenario and",
    "import cvs x": "cvs: no such format; did you mean csv?",
    "run q1-long-dense --sead 1": "--sead: no option of `slamgauge run`; did you mean --seed?",
    "run q1-long-dense -seed 1": "-seed: no option of `slamgauge run`; did you mean --seed?",
    "twin log.npz --run 3": "--run: no option of `slamgauge twin`; `slamgauge twin --help` lists",
    "import csv log --set=a.b=1 --ouut x": "--ouut: no option of `slamgauge import csv`; did you mean --out?",
    "run q1-long-dense --seed x": "--seed: 'x' is not a whole number; see `slamgauge run --help`",
    "evaluate x --align se3": "--align: 'se3' is not one of none, se2; did you mean se2?",
    "run q1-long-dense more": "more: one word too many; see `slamgauge run --help`",
    "--versoin": "--versoin: no option of `slamgauge`; did you mean --version?",
    "run q1-long-dense --estimators ekf,isam": "estimator 'isam' is not known; did you mean isam2?",
    "run q1-short-dense --estimators bound --out o": "bound: is a bound, which estimates nothing; `slamgauge study` ",
    "run q1-long-dense --estimators ,": "estimators: none given; ",
    "run q1-short-dense --seed -1 --out o": "seed: -1 is not valid; use a whole number >= 0",
    "run tp4-handout --timeout 2147484": "timeout: 2.14748e+06 s leaves no time, or sets no limit",
    "import csv none": "none: cannot be read (No such file or directory); check the path",
    "evaluate a\u2028b\x1b.npz": "a\\u2028b\\x1b.npz: cannot be read",
    "evaluate x --estimates mine": "estimates 'mine': write LABEL=PATH, for example mine=mine.csv",
    f"evaluate {'x' * 5000}": f"{'x' * 60}",
    f"bench --landmarks {'1' * 5000}": "landmarks '111",
    f"bench --landmarks {MANY}": "landmarks: the covariance of 100000000 needs",
    f"study q1-short-dense --runs {MANY}": "runs: to sum up 100000000 of",
    f"grade . --scenario q1-short-dense --runs {MANY} --unconfined --out o": "runs: to sum up",
    "budget q1-short-dense --runs 100000000000 --out o": "runs: a budget of 100000000000",
    "study q1-short-dense --runs 0": "runs: 0 is too few; give at least 1",
    "budget q1-short-dense --seed -1 --out o": "seed: -1 is negative; use a whole number >= 0",
    "budget q1-short-dense --filter batch --out o": "filter: 'batch' is not a filter whose error can be split; use",
    "study q1-short-dense --estimators ekf --against riekf": "estimator 'riekf': is not among --estimators; choose",
    "study q1-short-dense --against ekf --sweep fis.beta=1,9": "sweep: takes no --against and no --baseline; study a",
    "exercise q5": "question 'q5' is not known; use q1, q2, q3, q4",
    "evaluate x --estimators nowhere_at_all:estimate": "estimator nowhere_at_all:estimate: no module ",
    "evaluate x --estimators :estimate": "estimator ':estimate': write FILE.py:callable or module:callable, for",
    "study q1-short-dense --runs 1 --jobs 1025": "jobs: 1025 is out of range; give 1 to 1024",
}


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_is_refused_in_one_line(words: str, tmp_path: Path, mistake: Mistake):
    (tmp_path / "mine.py").write_text("def estimate(recording): ...\n")  # a submission
    save(tmp_path / "x", simulate(load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)[1])
    line = mistake(*words.split(" ")) if words else mistake()
    assert "\n" not in line
    assert line.startswith(COMMANDS[words])
    assert (f"s {MANY}" in words) == (" GB are free; " in line)


def test_each_mistake_in_a_scenario_is_a_line(mistake: Mistake, tmp_path: Path):
    wrong = ("sensor.max_range=-5", "motion.sigma_sped=1", "start=somewhere")
    lines = mistake("run", "q1-long-dense", "--set", *wrong).splitlines()
    assert [line.split(": ")[1] for line in lines] == ["start", "motion.sigma_sped", "sensor.max_range"]
    (tmp_path / "mark.toml").write_bytes(b"\xef\xbb\xbfextends = 'tp4-handout'\nmark = 1\n")
    assert mistake("run", "mark.toml").startswith("mark.toml: mark: unknown key")


# --- memory ------------------------------------------------------------------------------------


def test_a_graph_that_does_not_fit_is_refused_before_any_estimator_runs(
    mistake: Mistake, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("slamgauge.compare.scoring.comparison.compare_estimators", pytest.fail)
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e9)
    settings = ("landmarks={random={count=9000,box=[-5.0,-5.0,5.0,5.0]}}", "trajectory.duration=0.2")
    for graph in ("causal", "fixed-lag-5"):
        line = mistake("run", "q1-short-dense", "--set", *settings, "--estimators", f"dead-reckoning,{graph}")
        what = f"{graph} of 9000 landmarks in 3 poses"
        assert re.fullmatch(rf"{what} needs [\d.]+ GB of memory, and 2.0 GB are free; .*", line)


def test_a_run_that_does_not_fit_is_refused_by_its_steps_or_observations(monkeypatch: pytest.MonkeyPatch):
    for free, start in ((1e4, "a run of 628 steps among"), (4e5, r"a run of \d{4} observations")):
        monkeypatch.setattr("slamgauge.memory.free_memory", lambda free=free: free)
        with pytest.raises(ValueError, match=rf"^{start} [^\n]*needs 0.0 GB of memory.*; shorten trajectory.duration"):
            simulate("q1-short-dense", 0)


def test_estimates_that_do_not_fit_are_refused_before_the_first(
    tmp_path: Path, mistake: Mistake, monkeypatch: pytest.MonkeyPatch
):
    """A recording of 628 steps, with memory for the estimates of one filter, but not for those of three."""
    save(tmp_path / "r.npz", simulate("q1-short-dense", 0)[1])
    require_room_for_runs(1000, load_scenario("q1-long-dense"), 3)  # a usual study is not refused
    monkeypatch.setattr("slamgauge.memory.free_memory", lambda: 2e5)
    what = "estimators: 3 of 628 steps: what they estimate needs 0.0 GB of memory, "
    assert mistake("evaluate", "r.npz", "--estimators", "ekf,riekf,fej-ekf").startswith(what)
    assert run("evaluate", "r.npz", "--estimators", "dead-reckoning") == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit the address space")
def test_too_little_memory_for_the_libraries_is_one_line():
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (300_000_000, 300_000_000))"
    words = command_after(limit, "run", "q1-short-dense", "--estimators", "dead-reckoning", "--out", "nowhere")
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == REFUSED
    assert re.fullmatch(r"slamgauge: the machine refused: [^\n]*make room[^\n]*\n", done.stderr)
    assert not refused_by_the_machine(ImportError("no module named x"))


# --- exit status -------------------------------------------------------------------------------

LISTED = "slamgauge.compare.scenarios.scenario.shipped_scenarios"


def test_other_errors_are_defects_with_a_traceback_and_where_to_report_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(LISTED, Mock(side_effect=ValueError("broadcast")))
    assert run("scenarios") == 70
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = printed.err.splitlines()
    assert (lines[0], lines[-2]) == ("Traceback (most recent call last):", "ValueError: broadcast")
    assert lines[-1].startswith("slamgauge: this is a defect of slamgauge, not a mistake of yours; please report it")
    assert f"slamgauge {slamgauge.__version__}" in lines[-1]


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 8 TiB"), OSError(errno.ENOSPC, "No space left on device")]
)
def test_refusals_of_the_machine_are_one_line(error: Exception, monkeypatch: pytest.MonkeyPatch, mistake: Mistake):
    monkeypatch.setattr(LISTED, Mock(side_effect=error))
    line = mistake("scenarios", status=71)
    assert str(error) in line
    assert line.endswith("; make room and give the same command again")
