"""Processes with user code: what code behind the wall sees, may take, and leaves, their end, and what they answer.

Every field of an answer that slamgauge would not write is an error of one line.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import indent
from time import monotonic, sleep

import numpy as np
import pytest

from slamgauge import Estimate
from slamgauge.compare.estimators import answers
from slamgauge.compare.estimators.answers import Answer, message, read_answer
from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.requests import Limits, address
from slamgauge.compare.estimators.sandbox import CODE, has_wall
from slamgauge.compare.estimators.user_errors import UserCodeError

from .conftest import short

pytestmark = pytest.mark.slow
needs_wall = pytest.mark.skipif(not has_wall(), reason="this system has no bwrap")

HEAD = """
import os, signal, socket, subprocess, sys
import numpy as np
from pathlib import Path
from slamgauge import Estimate, chain

def estimate(recording):
"""
WRITABLE = ("/tmp", "/dev/shm", "/slamgauge")
Walled = Callable[..., Host]


@pytest.fixture
def walled(tmp_path: Path):
    """Return a function that makes a host behind a wall; it runs these statements."""
    hosts: list[Host] = []

    def made(statements: str, seconds: float = 60.0) -> Host:
        (tmp_path / "class/mine").mkdir(parents=True, exist_ok=True)
        file = tmp_path / "class/mine/mine.py"
        end = "    return Estimate('filtered', chain(recording.prior_mean, recording.odometry))\n"
        file.write_text(f"{HEAD}{indent(statements, '    ')}\n{end}")
        hosts.append(Host(address(f"mine={file}:estimate"), Limits(seconds, is_walled=True)))
        return hosts[-1]

    yield made
    for host in hosts:
        host.close()


def reason(host: Host) -> str:
    with pytest.raises(UserCodeError) as caught:
        host.run(short())
    return str(caught.value)


@needs_wall
def test_it_sees_its_own_folder_and_neither_truth_nor_other_submissions(walled: Walled, tmp_path: Path):
    (tmp_path / "class/other").mkdir(parents=True)
    (tmp_path / "class/other/other.py").write_text("secret = 1")
    (tmp_path / "class/mine").mkdir()
    for name in ("truth.npz", "class/mine/truth.npz"):
        np.savez(tmp_path / name, poses=np.zeros((1, 3)))
    (tmp_path / "class/mine/helper.py").write_text("")
    names = [str(tmp_path), str(Path.home() / ".ssh"), "/etc/shadow", __file__]
    what = f"raise ValueError([sorted(os.listdir({CODE!r})), [each for each in {names} if os.path.exists(each)]])"
    assert "ValueError: [['helper.py', 'mine.py'], []]" in reason(walled(what))


@needs_wall
@pytest.mark.parametrize(
    ("statements", "expected"),
    [
        ("Path('/usr/evil').write_text('')", "Read-only file system"),
        (f"Path('{CODE}/mine.py').write_text('')", "Read-only file system"),
        ("Path(sys.executable).resolve().with_name('evil').write_text('')", "Read-only file system"),
        ("raise ValueError([each for _, each in socket.if_nameindex()])", "ValueError: ['lo']"),
        ("socket.create_connection(('127.0.0.1', PORT), timeout=5)", "refused"),
        ("socket.create_connection(('1.1.1.1', 53), timeout=5)", "unreachable"),
        ("raise ValueError(any(b'pytest' in p.read_bytes() for p in Path('/proc').glob('*/cmdline')))", "False"),
        ("raise ValueError(os.listdir('/dev/shm'))", "ValueError: []"),
        ("np.ones(600_000_000)", "its process may take 4 GB"),
        ("Path('/tmp/large').open('wb').truncate(600_000_000)", "File too large"),
        ("[open('/dev/null') for _ in range(2000)]", "Too many open files"),
        ("[os.fork() or signal.pause() for _ in range(300)]", "Resource temporarily unavailable"),
        ("raise ValueError(os.getuid() == 0)", "ValueError: False"),  # also where root runs slamgauge
    ],
)
def test_what_it_may_not_do_or_take(walled: Walled, statements: str, expected: str):
    with socket.create_server(("127.0.0.1", 0)) as server:
        host = walled(statements.replace("PORT", str(server.getsockname()[1])), 5.0)
        assert expected in reason(host)


@needs_wall
def test_programs_below_a_writable_folder_are_seen_and_stay(walled: Walled, monkeypatch: pytest.MonkeyPatch):
    with TemporaryDirectory(dir="/tmp") as folder:
        monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
        host = walled(f"Path('/tmp/left').touch()\nraise ValueError(os.path.ismount({folder!r}), os.listdir('/tmp'))")
        first = reason(host)
        assert first == reason(host) and "ValueError: (True, [" in first


@needs_wall
def test_a_run_leaves_nothing_for_the_next_one(walled: Walled):
    """Neither files, nor processes, nor changes of its modules."""
    host = walled(f"""
found = [sorted(os.listdir(each)) for each in {WRITABLE}]
found += [len([each for each in os.listdir('/proc') if each.isdigit()]), hasattr(np, 'left')]
for each in {WRITABLE}:
    Path(each, 'left').mkdir()
    Path(each, 'left/file').write_text('x')
np.left = 1
if os.fork() == 0:
    os.setsid()
    signal.pause()
raise ValueError(found)""")
    first = reason(host)
    assert first == reason(host)
    assert "[], ['.cache']" in first and "left" not in first


def descendants(pid: int) -> set[int]:
    """Return the processes that a process has started, and those that they have started."""
    parents: dict[int, int] = {}
    for each in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(each.parent.name)] = int(each.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    found = {pid}
    while more := {child for child, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {pid}


def are_gone(pids: set[int]) -> bool:
    """Wait up to 20 s for the end of processes."""
    end, living = monotonic() + 20.0, pids
    while living and monotonic() < end:
        living = {pid for pid in living if Path(f"/proc/{pid}").exists()}
        sleep(0.1)
    return not living


ORPHANS = """
import sys
from pathlib import Path
from slamgauge import load_scenario, simulate
from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.requests import Limits, address
host = Host(address(f"mine={sys.argv[1]}:estimate"), Limits(600.0, is_walled=sys.argv[2] == "walled"))
host.begin()
print("begun", flush=True)
host.run(simulate(load_scenario("q1-short-dense", ["trajectory.duration=1"]), 0)[1])
"""


@pytest.mark.parametrize("how", [pytest.param("walled", marks=needs_wall), "plain"])
def test_no_process_survives_a_killed_parent(tmp_path: Path, how: str):
    (tmp_path / "mine.py").write_text("def estimate(recording):\n    while True: pass\n")
    words = [sys.executable, "-c", ORPHANS, str(tmp_path / "mine.py"), how]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None and parent.stdout.readline() == "begun\n"
        sleep(1.0)
        started = descendants(parent.pid)
        parent.kill()
    assert started and are_gone(started)


@needs_wall
def test_the_time_ends_all_that_it_has_started_also_in_other_sessions(walled: Walled):
    before = descendants(os.getpid())
    host = walled("subprocess.Popen(['sleep', '1000'], start_new_session=True)\nwhile True: pass", 3.0)
    host.begin()
    started = descendants(os.getpid()) - before
    assert "it was not done after 3 s" in reason(host)
    assert started and are_gone(started)
    assert not [each for each in descendants(os.getpid()) - before if "sleep" in Path(f"/proc/{each}/comm").read_text()]


@needs_wall
def test_the_host_starts_again_after_the_end_of_its_process(walled: Walled):
    with closing(walled("if recording.steps > 30: os.kill(os.getppid(), signal.SIGKILL); os._exit(0)")) as host:
        assert "its process" in reason(host)
        assert len(host.run(short().first(20)).estimate.poses) == 21


# --- answers -----------------------------------------------------------------------------------


def npz(**arrays: object) -> bytes:
    file = BytesIO()
    np.savez(file, **arrays)  # pyrefly: ignore[bad-argument-type]
    return file.getvalue()


def test_an_estimate_arrives_as_it_was_sent():
    sent = Estimate("filtered", np.zeros((3, 3)))
    stream = BytesIO(message({"seconds": 0.5, "remarks": ["one"]}, sent) + message({"form": "two"}))
    first, second = read_answer(stream), read_answer(stream)
    assert first is not None and second is not None
    np.testing.assert_array_equal(first.estimate().poses, sent.poses)
    assert (first.seconds(1.0), first.texts("remarks"), first.error) == (0.5, ["one"], None)
    assert (second.text("form"), read_answer(stream)) == ("two", None)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"[]\n", "not a JSON object"),
        (b"{\n", "not a line of JSON"),
        (b"[" * 50_000 + b"\n", "not a line of JSON"),
        (b'{"bytes": 1' + b"0" * 5000 + b"}\n", "not a line of JSON"),
        (b'{"bytes": NaN}\n', "bytes is not a size"),
        (b'{"bytes": -1}\n', "bytes is not a size"),
        (b'{"bytes": true}\n', "bytes is not a size"),
        (b"{}\n", "bytes is not a size"),
        (b"x" * 2_000_000, "too long a line"),
        (b'{"bytes": 500000001}\n', "its estimate has 500 MB; keep it below 500 MB"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes, expected: str):
    with pytest.raises(UserCodeError, match=expected):
        read_answer(BytesIO(data))


def test_fields_have_times_of_runs_and_short_printable_lines():
    for value in (np.nan, np.inf, -1, 1e9, 10**400, True, None, "1", [1]):
        with pytest.raises(UserCodeError, match=r"^its process wrote a wrong answer .seconds is not from 0 to .*leave"):
            Answer({"seconds": value}, b"").seconds(1.0)
    assert Answer({"form": "a\x1b[31m\n" + "x" * 5000}, b"").text("form") == "a [31m " + "x" * 993
    for remarks in ("one", ["one", 2], ["one"] * 101, {"one": 1}):
        with pytest.raises(UserCodeError, match="remarks is not a short list of texts"):
            Answer({"remarks": remarks}, b"").texts("remarks")
    with pytest.raises(UserCodeError, match="attribute is not a text"):
        Answer({"attribute": 1}, b"").text("attribute")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "its estimate is not an npz file"),
        (b"junk", "its estimate is not an npz file"),
        (b"\x93NUMPY\x01\x00", "its estimate is not an npz file"),
        (npz(kind=object()), "not a whole npz file of plain arrays"),
        (npz(kind="filtered", poses="x"), "poses"),
        (npz(kind="filtered", poses=np.zeros((2, 3)), more=1.0), "more"),
        (npz(kind="filtered", poses=np.zeros((1000, 3))), "its estimate has 0 MB; keep it below 0 MB"),
    ],
)
def test_what_is_no_estimate_is_refused(content: bytes, expected: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(answers, "MOST_BYTES", 10_000)
    with pytest.raises(UserCodeError, match=rf"^[^\n]*{expected}[^\n]*$"):
        Answer({}, content).estimate()
