"""A class with hostile submissions: each has its reason in one line, and the honest one its grade as without them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from slamgauge.compare.estimators.sandbox import has_wall

pytestmark = [
    pytest.mark.skipif(not has_wall(), reason="this system has no bwrap"),
    pytest.mark.slow,
]

EXAMPLES = Path(__file__).parents[3] / "examples"
SCENARIO = 'extends = "q1-short-dense"\n\n[trajectory]\nduration = 3.0\n'
HEAD = """
import ctypes, io, os, signal, sys, zipfile
import numpy as np
from pathlib import Path
import slamgauge
from slamgauge import Estimate, chain
worker = sys.modules['__main__']

message = worker.message

def forged(**changes):
    def answer(fields, estimate=None):
        return message({**fields, **changes} if "seconds" in fields else fields, estimate)
    worker.message = answer

def estimate(recording):
    poses = chain(recording.prior_mean, recording.odometry)
"""
ATTACKS = {
    "link": ("os.symlink(THESIS, '../given.npz')", "Read-only file system"),
    "fifo": ("os.mkfifo('../given.npz')", "Read-only file system"),
    "bytecode": (
        "next(Path(slamgauge.__file__).parent.rglob('*.pyc')).write_bytes(b'evil')",
        "Read-only file system",
    ),
    "stopped": (
        "os.kill(os.getppid(), signal.SIGSTOP); os.kill(os.getpid(), signal.SIGSTOP)",
        "it was not done after 5 s",
    ),
    "killed": ("os.kill(os.getpid(), signal.SIGKILL)", "its process was ended by SIGKILL"),
    "nan": ("forged(seconds=float('nan'))", "wrong answer (seconds is not from 0 to"),
    "left": (
        """place = Path('/dev/shm/poses')
    if recording.steps == 30:
        poses[:-1] = poses[1:]
        place.write_bytes(poses.tobytes())
    elif place.exists():
        poses = np.frombuffer(place.read_bytes()).reshape(-1, 3)[: recording.steps + 1]""",
        "uses the future",
    ),
    "seed": (
        """words = [path.read_bytes() for path in Path('/proc').glob('*/cmdline')]
    assert any(b'--seed' in each for each in words), 'no seed'""",
        "no seed",
    ),
    "descriptors": (
        """for each in map(int, os.listdir('/proc/self/fd')):
        try:
            os.write(each, b'x' * 1000)
        except OSError:
            pass""",
        "wrong answer (not a line of JSON)",
    ),
    "traced": (
        """libc = ctypes.CDLL(None, use_errno=True)
    if libc.ptrace(16, os.getppid(), None, None) < 0:
        raise OSError(ctypes.get_errno(), 'not traced')""",
        "it was not done after 5 s",  # it may stop its process, and waits for it then
    ),
    "everybody": ("os.kill(-1, signal.SIGKILL)", "its process "),
    "flood": ("for _ in range(100): print('x' * 1_000_000)", "it printed more than 10 MB in a run"),
    "deaf": (
        """for each in signal.SIGTERM, signal.SIGINT, signal.SIGHUP:
        signal.signal(each, signal.SIG_IGN)
    while True:
        signal.pause()""",
        "it was not done after 5 s",
    ),
    "closed": ("os.closerange(0, 100)", "its process ended with status "),
    "inodes": (  # bwrap limits the size of /tmp and no number of files: the time ends it
        "n = 0\n    while True:\n        Path('/tmp', str(n)).touch()\n        n += 1",
        "it was not done after 5 s",
    ),
    "objects": ("poses = np.array([[poses, 1, 2]] * len(poses), dtype=object)", "not an array of numbers"),
    "endless": (
        """class Endless:
        def __array__(self, *_, **__): return np.asarray(self)
        def __len__(self): return len(self)
        def __float__(self): return float(self)
    poses = Endless()""",
        "maximum recursion depth exceeded",
    ),
    "altered": (
        """answer = Estimate('filtered', poses)
    object.__setattr__(answer, 'poses', np.full_like(poses, np.nan))
    return answer""",
        "every number must be finite",
    ),
    "overstated": (
        """def save(file, **_):
        head = io.BytesIO()
        shape = {'descr': '<f8', 'fortran_order': False, 'shape': (10**11, 3)}
        np.lib.format.write_array_header_1_0(head, shape)
        with zipfile.ZipFile(file, 'w') as archive:
            archive.writestr('poses.npy', head.getvalue())
    np.savez = save""",
        "not a whole npz file of plain arrays",
    ),
    "long": ("raise ValueError('x' * 10**8)", "it raised ValueError: xxx"),
    "mute": (
        """class Mute(Exception):
        def __str__(self): return str(self)
    raise Mute""",
        "it raised Mute: (no message: its text raised RecursionError)",
    ),
    "numpy": ("raise ValueError('not the numpy of others')", "not the numpy of others"),
}


def graded(folder: Path, out: Path) -> dict[str, dict[str, object]]:
    """Grade a class by the command; return its rows by submission."""
    scenario = out.with_name("little.toml")
    scenario.write_text(SCENARIO)
    words = ("--runs 2 --seed 7 --timeout 5 --jobs 2 --json --no-report --scenario", scenario, "--out", out)
    command = [sys.executable, "-m", "slamgauge", "grade", str(folder), *" ".join(map(str, words)).split()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500)
    assert done.stdout, done.stderr
    return {each["submission"]: each for each in json.loads(done.stdout)}


def test_each_attack_has_its_reason_and_the_honest_grade_is_the_same(tmp_path: Path):
    (folder := tmp_path / "class").mkdir()
    (thesis := tmp_path / "thesis.txt").write_text("years of work")
    shutil.copy(EXAMPLES / "student_ekf.py", folder / "honest.py")
    alone = graded(folder, tmp_path / "alone")
    for name, (body, _) in ATTACKS.items():
        source = f"THESIS = {str(thesis)!r}\n{HEAD}    {body}\n    return Estimate('filtered', poses)\n"
        (folder / f"{name}.py").write_text(source)
    rows = graded(folder, tmp_path / "together")
    reasons = {name: str(rows[name]["reason"]) for name in ATTACKS}
    missed = [name for name, (_, expected) in ATTACKS.items() if expected not in reasons[name] or "\n" in reasons[name]]
    assert {name: reasons[name] for name in missed} == {}
    measured = {key: value for key, value in rows["honest"].items() if "seconds" not in key and key != "command"}
    assert measured == {key: value for key, value in alone["honest"].items() if key in measured}
    assert rows["honest"]["passed"]
    assert thesis.read_text() == "years of work"
