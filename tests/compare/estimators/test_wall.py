"""The wall around user code: each attack is tried by a submission, and reaches nothing of ours."""

from __future__ import annotations

import ctypes
import os
import socket
import sys
from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path
from textwrap import dedent, indent

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators import launched_process, wall
from slamgauge.compare.estimators.isolated_process import Isolated
from slamgauge.compare.estimators.user_code import UserCodeError, address
from slamgauge.compare.estimators.wall import has_bwrap, kind_of_wall
from slamgauge.errors import UserError

from .conftest import short

pytestmark = [
    pytest.mark.skipif(kind_of_wall() == "none", reason="this system permits neither namespaces nor bwrap"),
    pytest.mark.slow,
]

HEAD = """
import ctypes, os, signal, sys, threading, time
from pathlib import Path
from slamgauge import Estimate, chain

libc = ctypes.CDLL(None, use_errno=True)

def dead_reckoning(recording):
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry))

def refused(*attempts):
    for number, attempt in enumerate(attempts):
        try:
            attempt()
        except OSError:
            continue
        raise AssertionError(f"attempt {number} succeeded")

def estimate(recording):
"""

Made = Callable[[str], Isolated]


@pytest.fixture(params=["", "bwrap"])
def made(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Generator[Made]:
    """Return a function that makes an isolated estimator of a file `mine.py`, behind the best wall and by bwrap."""
    if request.param:
        if not has_bwrap():
            pytest.skip("bwrap is not installed, or this system does not permit it")
        monkeypatch.setattr(launched_process, "kind_of_wall", lambda: request.param)
    open_ones: list[Isolated] = []

    def make(body: str) -> Isolated:
        (tmp_path / "mine.py").write_text(
            f"{HEAD}{indent(dedent(body), '    ')}\n    return dead_reckoning(recording)\n"
        )
        open_ones.append(Isolated(address(f"{tmp_path / 'mine.py'}:estimate"), 20.0))
        return open_ones[-1]

    yield make
    for each in open_ones:
        each.close()


def states(folder: Path) -> dict[str, object]:
    """Return content, mode, owner and times of the files in a folder."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        status = path.stat()
        found[str(path)] = (
            path.read_bytes() if path.is_file() else b"",
            status.st_mode,
            status.st_uid,
            status.st_mtime,
        )
    return found


def test_nothing_of_ours_can_be_changed_or_signalled(made: Made, tmp_path: Path):
    """A1, A2, A6: files of the teacher beside the submission, of slamgauge and of Python; modes, owners, times."""
    (tmp_path / "thesis.txt").write_text("years of work")
    estimator = made(
        """
        import slamgauge
        ours = [Path(__file__).with_name("thesis.txt"), Path(slamgauge.__file__), Path(sys.executable).resolve()]
        bytecode = next(Path(slamgauge.__file__).parent.rglob("*.pyc"))
        for file in (*ours, bytecode):
            refused(
                lambda: file.open("ab"), lambda: os.truncate(file, 0), lambda: file.unlink(),
                lambda: file.chmod(0o777),
                lambda: os.chown(file, 0, 0), lambda: os.utime(file, (0, 0)), lambda: os.setxattr(file, "user.x", b"1"),
                lambda: os.rename(file, "/tmp/x"), lambda: os.link(file, "/tmp/x"),
                lambda: file.with_name("new.pyc").write_bytes(b"x"), lambda: file.parent.chmod(0o777),
                lambda: os.symlink("/etc/passwd", file.with_name("given.npz")),
                lambda: os.mkfifo(file.with_name("given.npz")),
            )
        refused(
            lambda: os.symlink(ours[0], "../given.npz"), lambda: os.mkfifo("../given.npz"), lambda: Path("/x").touch(),
            lambda: os.chroot("/tmp"), lambda: Path("/proc/sys/kernel/hostname").write_text("x"),
        )
        assert libc.mount(b"none", b"/", None, 32 | 4096, None) == -1  # to write
        os.kill(os.getppid(), signal.SIGSTOP)  # the first process of the namespace, which no signal of its own reaches
        """
    )
    before = states(tmp_path)
    estimator(short())
    del before[str(tmp_path / "mine.py")]
    assert before == {name: state for name, state in states(tmp_path).items() if not name.endswith("mine.py")}


def test_no_other_process_memory_environment_and_secret_is_in_reach(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A3 and A5: no thread outside, no process of ours in /proc, and no file but those of system and submission."""
    secret = tmp_path / "results" / "truth.npz"
    secret.parent.mkdir()
    secret.write_text("truth")
    monkeypatch.setenv("SECRET_TOKEN", "hush")
    home = Path.home()
    estimator = made(
        f"""
        os.getppid = lambda: 1  # once the thread that followed slamgauge would have called it
        assert threading.active_count() == 1
        opened = {{os.readlink(path) for path in Path("/proc/self/fd").iterdir() if path.exists()}}
        assert not [name for name in opened if name.startswith("socket") or name.startswith("/old")], opened
        assert sum(name.startswith("pipe") for name in opened) == 3, opened  # requests, answers, output
        assert len(os.listdir("/proc/self/task")) == 1
        alive = {{int(name) for name in os.listdir("/proc") if name.isdigit()}}
        assert alive == {{1, os.getpid()}}, alive
        for name in ("environ", "cmdline", "mem"):
            refused(lambda: open(f"/proc/{os.getpid()}/{{name}}"), lambda: open(f"/proc/{os.getppid()}/{{name}}"))
        shown = Path("/proc/1/cmdline").read_bytes() + Path("/proc/self/environ").read_bytes()
        assert b"hush" not in shown and b"seed" not in shown, shown
        assert "SECRET_TOKEN" not in os.environ
        refused(
            lambda: open({str(secret)!r}), lambda: open("/etc/shadow"), lambda: os.listdir({str(home / ".ssh")!r}),
            lambda: os.listdir("/var"), lambda: os.listdir("/run"),
        )
        assert os.listdir({str(secret.parent)!r}) == []
        assert os.getuid() != 0
        """
    )
    estimator(short())


def test_nothing_is_left_for_the_next_run(made: Made):
    """A4: the run on the whole recording leaves its poses wherever it can, the run on its beginning looks for them."""
    if os.uname().machine == "x86_64":
        ctypes.CDLL(None).syscall(250, 1, None)  # begin a session with keys, as a login does
    estimator = made(
        """
        import subprocess
        from multiprocessing import shared_memory
        places = [Path(name, "left") for name in ("/dev/shm", "/tmp", ".", os.environ["HOME"], "/var/tmp", "/run")]
        found = [str(place) for place in places if place.exists()]
        assert not found, found
        for place in places:
            try:
                place.write_text("poses")
            except OSError:
                pass
        key = libc.shmget(12345, 4096, 0o1600)
        assert key >= 0, "System V memory of an earlier run"
        assert libc.msgget(12345, 0o3600) >= 0, "a queue of an earlier run"
        if os.uname().machine == "x86_64":
            session = ctypes.c_long(-3)
            assert libc.syscall(250, 10, session, b"user", b"left", 0) == -1, "a key of an earlier run"
            assert libc.syscall(248, b"user", b"left", b"poses", ctypes.c_long(5), session) > 0
        assert len(os.listdir("/dev/shm")) == 1
        shared_memory.SharedMemory("left-too", create=True, size=8)
        subprocess.Popen(["sleep", "1000.75"], start_new_session=True)
        """
    )
    for _ in range(2):
        estimator(short())


def test_the_network_is_out_of_reach(made: Made):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        abstract = socket.socket(socket.AF_UNIX)
        abstract.bind("\0slamgauge-test")
        abstract.listen()
        estimator = made(
            f"""
            import socket
            local = socket.socket(socket.AF_UNIX)
            refused(
                lambda: socket.create_connection(("127.0.0.1", {port}), timeout=2.0),
                lambda: socket.create_connection(("1.1.1.1", 53), timeout=2.0),
                lambda: local.connect("\\0slamgauge-test"),
            )
            """
        )
        estimator(short())
        abstract.close()


@pytest.mark.parametrize("made", [""], indirect=True)
@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("os.kill(1, signal.SIGKILL); os.kill(os.getpid(), signal.SIGKILL)", "by SIGKILL"),
        ("os.kill(0, signal.SIGTERM); time.sleep(1.0)", "its process "),
        ("for name in '/tmp/x', '/tmp/y': Path(name).write_bytes(bytes(490_000_000))", "No space left"),
        ("[open(os.devnull) for _ in range(2000)]", "Too many open files"),
        ("[threading.Thread(target=time.sleep, args=[9]).start() for _ in range(999)]", "can't start new thread"),
        ("[os.fork() or time.sleep(9) for _ in range(999)]", "it "),
    ],
)
def test_harm_to_itself_is_one_line_and_the_next_run_is_as_the_first(made: Made, body: str, expected: str):
    estimator = made(f"if recording.steps > 20:\n    {body}")
    with pytest.raises(UserCodeError) as caught:
        estimator(short())
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    estimator(short().first(20))


@pytest.mark.skipif(os.geteuid() != 0 or sys.platform != "linux", reason="only root becomes another user")
def test_root_becomes_nobody_who_reads_the_files_of_the_submission(made: Made, tmp_path: Path):
    tmp_path.chmod(0o700)
    (tmp_path / "map.txt").write_text("data")
    (tmp_path / "map.txt").chmod(0o600)
    estimator = made(
        """
        assert (os.getuid(), os.getgid(), os.getgroups()) == (65534, 65534, [])
        assert Path(__file__).with_name("map.txt").read_text() == "data"
        status = dict(line.split(":", 1) for line in open("/proc/self/status"))
        capabilities = {name: int(status[name], 16) for name in ("CapPrm", "CapEff", "CapBnd", "CapAmb")}
        assert {*capabilities.values()} <= {0, 1 << 2}, capabilities  # reading
        assert status["NoNewPrivs"].strip() == "1"
        assert libc.unshare(1 << 28) == -1  # no namespaces within these
        """
    )
    estimator(short())


def test_without_a_wall_nothing_begins_unless_unconfined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(wall, "kind_of_wall", lambda: "none")
    (tmp_path / "mine.py").write_text(f"{HEAD}    return dead_reckoning(recording)\n")
    where = address(f"{tmp_path / 'mine.py'}:estimate")
    with pytest.raises(UserError, match=r"permits neither user namespaces nor bwrap.*or give --unconfined"):
        Isolated(where, 20.0).begin()
    with closing(Isolated(where, 20.0, unconfined=True)) as estimator:
        assert len(estimator(short()).poses) == short().steps + 1


@pytest.mark.parametrize("command", [["grade", "class", "--scenario", "q1-short-dense"], ["check", "class/mine.py"]])
def test_the_commands_refuse_in_one_line(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(wall, "kind_of_wall", lambda: "none")
    monkeypatch.chdir(tmp_path)
    Path("class").mkdir()
    Path("class/mine.py").write_text("def estimate(recording): raise AssertionError('it ran')")
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("install bubblewrap, or give --unconfined for code that you trust")
