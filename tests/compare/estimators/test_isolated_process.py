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
from contextlib import closing, suppress
from pathlib import Path
from textwrap import dedent, indent
from time import monotonic, sleep

import numpy as np
import pytest

from slamgauge import dead_reckoning, simulate
from slamgauge.compare.estimators import launched_process, launcher
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.launched_process import environment
from slamgauge.compare.estimators.launcher import FOLDERS
from slamgauge.compare.estimators.loading import load, spent_by
from slamgauge.compare.estimators.requests import Isolation, ask
from slamgauge.compare.estimators.requests import isolated as kept_apart
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.estimators.user_code import OverdueError, UserCodeError, address
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.errors import UserError
from tests.marks import in_full

from .conftest import EXAMPLES, short

pytestmark = pytest.mark.slow

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
    told = environment(ours | {"HOME": "/teacher"})
    kept = {key: value for key, value in told.items() if key in ours}
    assert kept == {"PATH": "/bin", "LC_ALL": "C", "OMP_NUM_THREADS": "1"}
    assert (told["HOME"], told["TMPDIR"], told["PWD"]) == (tempfile.gettempdir(),) * 3


def test_an_endless_loop_is_ended_with_all_that_it_has_started(made: Made):
    body = """
        import subprocess
        subprocess.Popen(["sleep", "1000.125"], start_new_session=True)
        print("round and round")
        sys.stderr.flush()
        while True:
            pass
    """
    with pytest.raises(OverdueError) as caught:
        made(body, 2.0)(short())
    remedy = "make it faster, or give a longer --timeout"
    assert str(caught.value) == f"it was not done after 2 s; {remedy} (it printed last: round and round)"
    assert ended("1000.125")


@pytest.mark.parametrize("unconfined", [False, *in_full([True])])
def test_an_endless_external_program_is_ended_too(tmp_path: Path, unconfined: bool):
    (tmp_path / "mine.py").write_text(
        "from slamgauge import adapters\n"
        "estimate = adapters.external(['sh', '-c', 'sleep 1000.25', '{recording}', '{estimate}'])\n"
    )
    estimator = Isolated(address(f"{tmp_path / 'mine.py'}:estimate"), 5.0, unconfined=unconfined)
    with ThreadPoolExecutor(1) as beside:
        started = beside.submit(await_program, "1000.25")
        with closing(estimator), pytest.raises(OverdueError):
            estimator(short())
    started.result()
    assert ended("1000.25")


def programs(word: str) -> list[int]:
    """Return the processes of the machine that have this word in their command line."""
    found = list[int]()
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            found += [int(place.parent.name)] if word.encode() in place.read_bytes().split(b"\0") else []
    return found


def await_program(word: str) -> None:
    """Return when such a process runs."""
    deadline = monotonic() + 60.0
    while not programs(word):
        assert monotonic() < deadline
        sleep(0.02)


def ended(word: str) -> bool:
    """Return whether all such processes end within 10 s."""
    deadline = monotonic() + 10.0
    while programs(word):
        if monotonic() > deadline:
            return False
        sleep(0.05)
    return True


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
    assert len(estimator.last_output) < launched_process.TAIL


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


def test_a_forged_answer_is_refused_in_one_line(made: Made):
    """User code replaces what writes the answers; `test_answers` has the forgeries."""
    body = """
        from slamgauge.compare.estimators import isolated_worker
        isolated_worker.message = lambda *_: b'{"seconds": NaN, "cpu_seconds": 0, "bytes": 0}\\n'
        return dead_reckoning(recording)
    """
    assert reason(made(body)).startswith("its process wrote a wrong answer (seconds is not from 0 to")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def estimate(recording)\n    pass", "cannot be loaded, it raised SyntaxError"),
        ("import os\nos._exit(4)", "cannot be loaded, its process ended with status 4"),
        ("import time\ntime.sleep(1000)", "cannot be loaded, it was not done after 2 s"),
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


@pytest.mark.parametrize("unconfined", [False, True])
@pytest.mark.parametrize("then", ["STARTED.wait()", "return dead_reckoning(recording)"])
def test_the_process_ends_and_leaves_nothing_if_its_parent_is_killed(tmp_path: Path, then: str, unconfined: bool):
    file = tmp_path / "mine.py"
    start = "import subprocess\nSTARTED = subprocess.Popen(['sleep', '1000.5'])"
    file.write_text(f"{HEAD}{start}\ndef estimate(recording):\n    STARTED.poll()\n    {then}\n")
    program = (
        "from slamgauge.compare.estimators.isolated_process import Isolated\n"
        "from slamgauge.compare.estimators.user_code import address\n"
        "from slamgauge import load_scenario, simulate\n"
        f"estimator = Isolated(address({str(file) + ':estimate'!r}), 60.0, unconfined={unconfined})\n"
        "estimator(simulate(load_scenario('q1-short-dense'), 0)[1])\n"
        "estimator.begin()\n"
        "import time; time.sleep(60.0)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], env={**os.environ, "TMPDIR": str(tmp_path)}) as parent:
        await_program("1000.5")
        parent.send_signal(signal.SIGKILL)
    assert ended("1000.5")
    deadline = monotonic() + 10.0
    while [*tmp_path.glob(f"{FOLDERS}*")]:
        assert monotonic() < deadline
        sleep(0.05)


def test_stored_results_depend_on_the_isolation():
    (within,) = ask([f"mine={EXAMPLES}/student_ekf.py:ekf_slam"])
    keys = {each.key for strict in (True, False) for each in kept_apart([within], Isolation(60.0, strict))}
    assert len(keys | {within.key}) == 3
    (ours,) = kept_apart(ask(["ekf"]), Isolation(60.0, strict=True))
    assert ours.isolation is None


def test_a_launcher_imports_installed_libraries_and_no_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "helper_of_a_user.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cycler", raising=False)
    programs = ["venv.__main__", "numpy.f2py.__main__", "antigravity"]  # each begins its work when it is imported
    launcher.import_installed(["helper_of_a_user", "cycler", *programs])
    assert "cycler" in sys.modules
    assert not {"helper_of_a_user", *programs} & {*sys.modules}


@only_linux
def test_a_launcher_is_limited_and_its_end_costs_only_its_code(made: Made):
    estimator = made("return dead_reckoning(recording)")
    estimator(short())
    launched = estimator._launcher
    assert launched is not None
    limits = Path(f"/proc/{launched._process.pid}/limits").read_text(encoding="ascii")
    assert re.search(r"^Max data size +4000000000 ", limits, re.M)  # compiling may multiply code
    launched._process.kill()
    launched._process.wait()
    assert "it takes too long or too much memory to compile" in reason(estimator)
