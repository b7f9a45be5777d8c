"""The wall and the end of processes with user code: what code behind it sees, may take, and leaves."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from textwrap import indent
from time import monotonic, sleep

import numpy as np
import pytest

from slamgauge.compare.estimators.child import Host
from slamgauge.compare.estimators.requests import Limits, address
from slamgauge.compare.estimators.sandbox import CODE, has_wall
from slamgauge.compare.estimators.user_errors import UserCodeError

from .conftest import short

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not has_wall(), reason="this system has no bwrap")]

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
        (f"raise ValueError([os.listdir(each) for each in {WRITABLE[:2]}])", "ValueError: [[], []]"),
        ("np.ones(600_000_000)", "its process may take 4 GB"),
        ("Path('/tmp/large').open('wb').truncate(600_000_000)", "File too large"),
        ("[open('/dev/null') for _ in range(2000)]", "Too many open files"),
        (  # the system limits the processes of root by nothing: there the time ends them
            "[os.fork() or signal.pause() for _ in range(300)]\nwhile True: pass",
            "Resource temporarily unavailable" if os.getuid() else "it was not done after 5 s",
        ),
        ("while True: pass", "it was not done after 5 s"),
    ],
)
def test_what_it_may_not_do_or_take(walled: Walled, statements: str, expected: str):
    with socket.create_server(("127.0.0.1", 0)) as server:
        host = walled(statements.replace("PORT", str(server.getsockname()[1])), 5.0)
        assert expected in reason(host)


def test_a_run_leaves_nothing_for_the_next_one(walled: Walled):
    """Neither files, nor processes, nor changes of its modules."""
    host = walled(
        f"found = [sorted(os.listdir(each)) for each in {WRITABLE}]\n"
        "found.append(len([each for each in os.listdir('/proc') if each.isdigit()]))\n"
        "found.append(hasattr(np, 'left'))\n"
        f"for each in {WRITABLE}:\n"
        "    Path(each, 'left').mkdir()\n"
        "    Path(each, 'left/file').write_text('x')\n"
        "np.left = 1\n"
        "if os.fork() == 0:\n"
        "    os.setsid()\n"
        "    signal.pause()\n"
        "raise ValueError(found)"
    )
    assert reason(host) == reason(host)
    assert "[[], [], ['.cache']" in reason(host)


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
    end = monotonic() + 20.0
    while any(Path(f"/proc/{pid}").exists() for pid in pids) and monotonic() < end:
        sleep(0.1)
    return not any(Path(f"/proc/{pid}").exists() for pid in pids)


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
ENDLESS = "import subprocess\ndef estimate(recording):\n    subprocess.run(['sleep', '1000'])\n    while True: pass\n"


@pytest.mark.parametrize("how", ["walled", "plain"])
def test_no_process_survives_a_killed_parent(tmp_path: Path, how: str):
    (tmp_path / "mine.py").write_text(ENDLESS.replace("subprocess.run(['sleep', '1000'])", "pass"))
    words = [sys.executable, "-c", ORPHANS, str(tmp_path / "mine.py"), how]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None and parent.stdout.readline() == "begun\n"
        sleep(1.0)
        started = descendants(parent.pid)
        parent.kill()
    assert started
    assert are_gone(started)


def test_the_time_ends_all_that_it_has_started_also_in_other_sessions(walled: Walled):
    before = descendants(os.getpid())
    host = walled("subprocess.Popen(['sleep', '1000'], start_new_session=True)\nwhile True: pass", 3.0)
    host.begin()
    started = descendants(os.getpid()) - before
    assert "it was not done after 3 s" in reason(host)
    assert started and are_gone(started)
    assert not [each for each in descendants(os.getpid()) - before if "sleep" in Path(f"/proc/{each}/comm").read_text()]


def test_the_host_starts_again_after_the_end_of_its_process(walled: Walled):
    with closing(walled("if recording.steps > 30: os.kill(os.getppid(), signal.SIGKILL); os._exit(0)")) as host:
        assert "its process" in reason(host)
        assert len(host.run(short().first(20)).estimate.poses) == 21
