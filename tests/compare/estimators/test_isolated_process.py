"""User code in a child process: the same estimates, no access to our data, and every end in one line."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from textwrap import dedent, indent
from time import monotonic, sleep

import numpy as np
import pytest

from slamgauge import dead_reckoning, simulate
from slamgauge.compare.estimators import isolated_process
from slamgauge.compare.estimators.isolated_process import Isolated, OverdueError, environment
from slamgauge.compare.estimators.loading import load, spent_by
from slamgauge.compare.estimators.requests import Isolation, ask
from slamgauge.compare.estimators.requests import isolated as kept_apart
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.estimators.user_code import UserCodeError, address
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.errors import UserError

from .conftest import EXAMPLES, short

HEAD = """import os, signal, sys
from slamgauge import Estimate, chain
def dead_reckoning(recording): return Estimate("filtered", chain(recording.prior_mean, recording.odometry))
"""  # that of slamgauge would load a compiler in every process

Made = Callable[..., Isolated]


only_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no such limit")


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generator[Made]:
    """Return a function that makes an isolated estimator with that body; its temporary folder is in `tmp_path`."""
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    open_ones: list[Isolated] = []

    def make(body: str, timeout: float = 60.0) -> Isolated:
        file = tmp_path / "mine.py"
        file.write_text(f"{HEAD}def estimate(recording):\n{indent(dedent(body), '    ')}\n")
        open_ones.append(Isolated(address(f"{file}:estimate"), timeout))
        return open_ones[-1]

    yield make
    for each in open_ones:
        each.close()
    assert not [*(tmp_path / "tmp").iterdir()]  # no test leaves anything


def reason(estimator: Isolated) -> str:
    with pytest.raises(UserCodeError) as caught:
        estimator(short())
    return str(caught.value)


def test_the_estimate_is_the_same_to_the_last_bit_and_the_form_is_printed(capsys: pytest.CaptureFixture[str]):
    (asked,) = kept_apart(ask([f"mine={EXAMPLES}/student_ekf.py:ekf_slam"]), Isolation(60.0, strict=False))
    recording = short()
    apart = load(asked)
    assert capsys.readouterr().err.splitlines()[0] == "mine: step function of the exercise (xEst, PEst, u, y)"
    (within,) = ask([f"mine={EXAMPLES}/student_ekf.py:ekf_slam"])
    estimates = [run_estimator("mine", each, recording)[0] for each in (apart, load(within))]
    for field in ("poses", "pose_covs", "landmark_ids", "landmarks", "landmark_covs", "association"):
        np.testing.assert_array_equal(*(getattr(each, field) for each in estimates))
    spent = spent_by(apart)
    assert spent is not None and 0 < spent.cpu_seconds <= spent.seconds + 0.1


def test_every_run_is_new_and_errors_of_one_do_not_end_the_next(made: Made):
    body = """
        global runs
        runs = globals().get("runs", 0) + 1
        open("left", "x").close()
        if recording.steps == 2:
            raise ValueError("the second")
        return dead_reckoning(recording.first(runs))
    """
    estimator = made(body)
    assert len(estimator(short()).poses) == 2
    with pytest.raises(UserCodeError, match=r"ValueError: the second \(mine.py, line"):
        estimator(short().first(2))
    assert len(estimator(short()).poses) == 2


def test_neighbours_of_the_file_can_be_imported(made: Made, tmp_path: Path):
    (tmp_path / "helper.py").write_text("from slamgauge import dead_reckoning as estimator")
    recording = short()
    estimate = made("import helper; return helper.estimator(recording)")(recording)
    assert np.array_equal(estimate.poses, dead_reckoning(recording).poses)


def test_the_truth_is_not_in_reach(made: Made, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """It is in no folder, argument, environment variable and object of the child."""
    monkeypatch.setenv("TRUTH", str(tmp_path / "truth.npz"))
    truth, _ = simulate(load_scenario("q1-short-dense"), 0)
    assert truth.poses is not None  # this process has it
    body = """
        import gc, tempfile
        from pathlib import Path
        from slamgauge import Truth
        held = [each for each in gc.get_objects() if isinstance(each, Truth)]
        same = Path.cwd() == Path.home() == Path(tempfile.gettempdir())
        here = [name for name in os.listdir() if name != ".cache"]
        raise ValueError(repr((here, same, sys.argv, os.environ.get("TRUTH"), held, sys.stdin.read())))
    """
    told = reason(made(body))
    assert told.startswith(f"it raised ValueError: ([], True, ['{tmp_path}/mine.py'], None, [], '') ")


def test_the_environment_contains_libraries_and_none_of_our_folders():
    ours = {"PATH": "/bin", "LC_ALL": "C", "OMP_NUM_THREADS": "1", "OLDPWD": "/results", "_": "/x", "OUT": "/results"}
    told = environment(ours | {"HOME": "/home/teacher"})
    kept = {key: value for key, value in told.items() if key in ours}
    assert kept == {"PATH": "/bin", "LC_ALL": "C", "OMP_NUM_THREADS": "1"}
    assert (told["HOME"], told["TMPDIR"], told["PWD"]) == (tempfile.gettempdir(),) * 3


def test_an_endless_loop_is_ended_with_all_that_it_has_started(made: Made):
    body = """
        import subprocess
        print("round and round with", subprocess.Popen(["sleep", "1000"]).pid)
        sys.stderr.flush()
        while True:
            pass
    """
    with pytest.raises(OverdueError) as caught:
        made(body, 2.0)(short())
    begin = "it was not done after 2 s; make it faster, or give a longer --timeout"
    said = re.fullmatch(rf"{begin} \(it printed last: round and round with (\d+)\)", str(caught.value))
    assert said is not None and ended(int(said[1]))


def test_an_endless_external_program_is_ended_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "program.sh").write_text("echo $$ > $HOME/pid\nwhile true; do sleep 0.1; done\n")
    (tmp_path / "mine.py").write_text(
        "from pathlib import Path\nfrom slamgauge import adapters\n"
        "program = Path(__file__).with_name('program.sh')\n"
        "estimate = adapters.external(['sh', str(program), '{recording}', '{estimate}'])\n"
    )
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    estimator = Isolated(address(f"{tmp_path / 'mine.py'}:estimate"), 5.0)
    with ThreadPoolExecutor(1) as beside:
        noted = beside.submit(pid_noted, tmp_path)
        with closing(estimator), pytest.raises(OverdueError):
            estimator(short())
    assert ended(noted.result())


def pid_noted(folder: Path) -> int:
    """Return the process id that user code wrote into the folder where it may write."""
    deadline = monotonic() + 60.0
    while monotonic() < deadline:
        for noted in folder.glob(f"{isolated_process.FOLDERS}*/{isolated_process.HERE}/pid"):
            if number := noted.read_text():
                return int(number)
        sleep(0.02)
    raise TimeoutError(folder)


def ended(pid: int) -> bool:
    """Return whether a process ends within 10 s."""
    deadline = monotonic() + 10.0
    while monotonic() < deadline:
        try:
            os.kill(pid, 0)
            status = Path(f"/proc/{pid}/stat")
            if status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z":
                return True  # it has ended, and its parent has not read its status
        except ProcessLookupError:
            return True
        sleep(0.05)
    return False


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (
            "print('good bye', flush=True); os._exit(3)",
            "its process ended with status 3 before the run was done (it pri",
        ),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "its process was ended by SIGSEGV"),
        ("exit()", "it raised SystemExit: None (mine.py, line 5); mend it and run again"),
        ("return recording", "returned a Recording; return a slamgauge.Estimate"),
        ("for fd in range(3, 50):\n    try: os.close(fd)\n    except OSError: pass", "its process "),
        ("raise ValueError('\\x1b[31m\\x00 red')", "it raised ValueError: [31m red (mine.py, line 5); mend it and run"),
        ("input()", "it raised EOFError"),
    ],
)
def test_every_end_is_one_line(made: Made, body: str, expected: str):
    told = reason(made(body))
    assert told.startswith(expected)
    assert "\n" not in told


def test_too_much_output_ends_the_run(made: Made):
    estimator = made("for _ in range(100_000):\n    print('x' * 999)\nreturn dead_reckoning(recording)")
    start = monotonic()
    assert reason(estimator).startswith(
        "it printed more than 10 MB in a run; take the prints out (it printed last: xxx"
    )
    assert monotonic() - start < 30.0


def test_the_last_lines_of_output_are_kept(made: Made):
    estimator = made("for i in range(20_000):\n    print('line', i)\nreturn dead_reckoning(recording)")
    estimator(short())
    assert estimator.last_output.splitlines()[-2:] == ["line 19998", "line 19999"]
    assert len(estimator.last_output) < isolated_process.TAIL


def test_the_size_of_files_is_limited(made: Made):
    body = "import resource; raise ValueError(resource.getrlimit(resource.RLIMIT_FSIZE))"
    assert "ValueError: (500000000, 500000000)" in reason(made(body))


@only_linux
@pytest.mark.parametrize("body", ["bytearray(50_000_000_000)", "__import__('numpy').ones(6_000_000_000)"])
def test_memory_is_limited_and_the_process_serves_further_runs(made: Made, body: str):
    estimator = made(f"if recording.steps > 20: {body}\nreturn dead_reckoning(recording)")
    told = reason(estimator)
    assert re.fullmatch(r"it raised .*MemoryError: .*; mend it and run again; its process may take 4 GB", told)
    assert estimator(short().first(20)).poses.shape == (21, 3)


@only_linux
def test_the_memory_limit_is_ten_times_the_need_and_the_process_is_ended_first(made: Made):
    body = """
        from slamgauge.ekf import ekf_slam
        from slamgauge.graph_baseline import batch
        ekf_slam(recording), batch(recording)
        taken = next(line for line in open("/proc/self/status") if line.startswith("VmData")).split()[1]
        assert int(taken) * 1024 < 400_000_000, taken
        assert len(__import__("numpy").zeros(437_500_000)) > 0
        assert open("/proc/self/oom_score_adj").read().strip() == "1000"
        return dead_reckoning(recording)
    """
    made(body)(short())


@pytest.mark.parametrize(
    ("left", "expected"),
    [
        ("open(path, 'wb').write(b'junk')", "its process has left a file that is no estimate"),
        ("__import__('numpy').save(open(path, 'wb'), 1.0)", "its process has left a file that is no estimate"),
        ("None", "its process has left no estimate"),
        ("os.symlink('/dev/zero', path)", "its process has left no estimate"),
        ("__import__('numpy').savez(path, kind=object())", "not a whole npz file of plain arrays"),
        ("__import__('numpy').savez(path, kind='filtered', poses='x')", "poses"),
    ],
)
def test_a_replaced_estimate_is_refused(made: Made, left: str, expected: str):
    body = f"""
        sys.modules["__main__"].save = lambda path, estimate: {left}
        return dead_reckoning(recording)
    """
    assert reason(made(body)).startswith(expected)


def test_an_estimate_too_large_to_read_is_refused(made: Made, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(isolated_process, "MOST_MADE", 1000)
    assert reason(made("return dead_reckoning(recording)")).startswith("its estimate has 0 MB; keep it below 0 MB")


def test_a_wrong_answer_is_refused(made: Made):
    body = """
        frame = sys._getframe()
        while "out" not in frame.f_locals or getattr(frame.f_locals["out"], "mode", "") != "w":
            frame = frame.f_back
        out = frame.f_locals["out"]
        out.write("[]\\n")
        out.flush()
        return dead_reckoning(recording)
    """
    assert reason(made(body)).startswith("its process wrote a wrong answer")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def estimate(recording)\n    pass", "cannot be loaded, it raised SyntaxError"),
        ("import os\nos._exit(4)", "cannot be loaded, its process ended with status 4"),
        ("while True: pass", "cannot be loaded, it was not done after 2 s"),
        ("exit()", "cannot be loaded, it raised SystemExit"),
        ("other = 1", "has no 'estimate'"),
    ],
)
def test_code_that_cannot_be_loaded_is_named(tmp_path: Path, source: str, expected: str):
    file = tmp_path / "mine.py"
    file.write_text(source)
    with pytest.raises(UserError) as caught:
        Isolated(address(f"{file}:estimate"), 2.0).begin()
    assert str(caught.value).startswith(f"estimator {file}:estimate: ")
    assert expected in str(caught.value)


@pytest.mark.parametrize("then", ["while True: pass", "return dead_reckoning(recording)"])
def test_the_process_ends_and_leaves_nothing_if_its_parent_is_killed(tmp_path: Path, then: str):
    file = tmp_path / "mine.py"
    note = "open('pid', 'w').write(str(os.getpid()))"
    file.write_text(f"{HEAD}def estimate(recording):\n    {note}\n    {then}\n")
    program = (
        "from slamgauge.compare.estimators.isolated_process import Isolated\n"
        "from slamgauge.compare.estimators.user_code import address\n"
        "from slamgauge import load_scenario, simulate\n"
        f"estimator = Isolated(address({str(file) + ':estimate'!r}), 60.0)\n"
        "estimator(simulate(load_scenario('q1-short-dense'), 0)[1])\n"
        "print(flush=True); import time; time.sleep(60.0)\n"
    )
    surroundings = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", program], env=surroundings, stdout=subprocess.PIPE) as parent:
        pid = pid_noted(tmp_path)
        if then.startswith("return"):
            assert parent.stdout is not None
            parent.stdout.readline()  # the child waits for another run
        parent.send_signal(signal.SIGKILL)
    assert ended(pid)
    assert not [*tmp_path.glob(f"{isolated_process.FOLDERS}*")]


def test_stored_results_depend_on_the_isolation():
    (within,) = ask([f"mine={EXAMPLES}/student_ekf.py:ekf_slam"])
    keys = {each.key for strict in (True, False) for each in kept_apart([within], Isolation(60.0, strict))}
    assert len(keys | {within.key}) == 3
    (ours,) = kept_apart(ask(["ekf"]), Isolation(60.0, strict=True))
    assert ours.isolation is None


def test_the_worker_started_by_hand_removes_nothing(tmp_path: Path):
    (tmp_path / "mine").mkdir()
    command = [sys.executable, "-P", "-m", isolated_process.PROGRAM, "3", "4"]
    ended = subprocess.run(command, cwd=tmp_path / "mine", capture_output=True, text=True, check=False)
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, 1)
    assert (tmp_path / "mine").is_dir()


@only_linux
def test_user_code_cannot_change_our_files(made: Made, tmp_path: Path):
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("years of work")
    body = f"""
        import os, shutil
        os.chdir({str(tmp_path)!r})
        shutil.rmtree({str(precious)!r}, ignore_errors=True)
        for change in (
            lambda: open("precious/thesis.txt", "a"), lambda: os.truncate("precious/thesis.txt", 0),
            lambda: os.remove("precious/thesis.txt"), lambda: os.rename("precious", "mine"), lambda: open("new", "w"),
        ):
            try:
                change()
            except PermissionError:
                continue
            raise AssertionError("it could")
        return dead_reckoning(recording)
    """
    made(body)(short())
    assert (precious / "thesis.txt").read_text() == "years of work"
    assert not (tmp_path / "new").exists()
