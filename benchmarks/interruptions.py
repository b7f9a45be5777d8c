"""Interrupt every command at several moments, give it again, and compare its results with those of a run to the end.

    python benchmarks/interruptions.py [--only NAME] [--moments 3] [--seed 0]

Each command runs once to its end, which measures its time. Then it is started again for each way to end it and each
moment: SIGINT, SIGINT twice, SIGTERM, SIGHUP, and SIGKILL. The two SIGINT and SIGHUP reach the processes that the
command has started too, as those of a terminal do. A case is bad if the command prints a traceback or a
warning of Python, does not end within 30 s, leaves temporary files (except after SIGKILL) or processes, or if the same
command, given again, ends with another status or other results. `--only` selects commands with NAME in their title.
The exit status is 1 if a case is bad.
"""

from __future__ import annotations

import atexit
import csv
import functools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import tyro

from slamgauge.compare.storage.staged_folder import MARK

ROOT = Path(__file__).parents[1]
SCENARIO = "q1-short-dense"
COMMANDS: dict[str, tuple[str, ...]] = {
    "run": ("run", SCENARIO, "--estimators", "ekf,causal,batch", "--out", "out"),
    "evaluate": ("evaluate", "given/recording.npz", "--estimators", "ekf,causal", "--out", "out"),
    "study": ("study", SCENARIO, "--runs", "12", "--jobs", "2", "--estimators", "ekf,riekf", "--out", "out"),
    "sweep": ("study", SCENARIO, "--runs", "4", "--sweep", "assumed.scale=1,2", "--estimators", "ekf", "--out", "out"),
    "budget": ("budget", SCENARIO, "--runs", "4", "--out", "out"),
    "import": ("import", "csv", "given/csv", "--out", "out"),
    "noise": ("noise", "given/recording.npz", "--out", "out"),
    "twin": ("twin", "given/recording.npz", "--out", "out"),
    "check": ("check", "filter.py:ekf_slam"),
    "grade": ("grade", "class", "--scenario", SCENARIO, "--runs", "2", "--seed", "0", "--out", "out"),
    "export": ("export", "given", "--format", "pdf", "--out", "out"),
    "animate": ("animate", "given"),
    "bench": ("bench", "--landmarks", "20", "--estimators", "ekf", "--out", "out"),
    "scenarios": ("scenarios",),
    "doctor": ("doctor",),
    "explain": ("explain", "nees"),
    "schema": ("schema", "metrics"),
    "completion": ("completion", "bash"),
}
WAYS: dict[str, tuple[int, ...]] = {
    "INT": (signal.SIGINT,),
    "INT twice": (signal.SIGINT, signal.SIGINT),
    "TERM": (signal.SIGTERM,),
    "HUP": (signal.SIGHUP,),
    "KILL": (signal.SIGKILL,),
}
GROUP = ("INT twice", "HUP")  # ways that end the whole group of processes, as a terminal does
BETWEEN = 0.2  # s from one signal to the next
ENDING = 30.0  # s: longest time from the last signal to the end
FOLLOWING = 5.0  # s: longest time in which the workers of a killed command end
CLOCK = ("seconds", "created", "execution_time")  # parts of the keys whose values depend on the clock
NOISE = ("Traceback", "Warning", "resource_tracker")  # no output may contain these


class Done(NamedTuple):
    """The end of a command: its exit status, what it printed, and its results by file."""

    status: int
    printed: str
    results: dict[str, Any]


def main(only: str = "", moments: int = 3, seed: int = 0) -> int:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # behind `&` a shell ignores it, also in what is started
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # so does nohup
    draw, cases, bad = random.Random(seed), 0, 0
    print(f"{'command':10}{'time [s]':>9}  bad cases of {len(WAYS) * moments}")
    for name, words in COMMANDS.items():
        if only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            began = time.monotonic()
            whole = run(words, Path(folder))
            lasts = time.monotonic() - began
        faults: list[str] = []
        for way in WAYS:
            for _ in range(moments):
                moment = draw.uniform(0.0, 1.0) * lasts
                faults += [f"{way} after {moment:.1f} s: {each}" for each in tried(words, way, moment, whole)[:1]]
        cases, bad = cases + len(WAYS) * moments, bad + len(faults)
        print(f"{name:10}{lasts:9.1f}  {len(faults)}", *faults, sep="\n    ", flush=True)
    print(f"{bad} of {cases} cases are bad")
    return 1 if bad else 0


def tried(words: tuple[str, ...], way: str, moment: float, whole: Done) -> list[str]:
    """Return the faults of one case: the command is ended at a moment [s], and given again."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        faults: list[str] = []
        try:
            stopped = run(words, folder, way, moment)
        except subprocess.TimeoutExpired:
            return [f"it did not end within {ENDING:g} s"]
        faults += [
            f"it printed {line!r}, at the end {stopped.printed[-400:]!r}"
            for line in stopped.printed.splitlines()
            if any(each in line for each in NOISE)
        ]
        faults += [f"process {each} is left" for each in left_processes(folder)]
        if way != "KILL":
            faults += [f"{each.name} is left in the temporary folder" for each in (folder / "tmp").iterdir()]
        again = run(words, folder)
        if again.status != whole.status:
            faults.append(f"given again it ended with status {again.status}: {again.printed[-200:]!r}")
        faults += [
            f"given again, {each} differs"
            for each in sorted({*again.results, *whole.results})
            if again.results.get(each) != whole.results.get(each)
        ]
        return faults


def prepare(folder: Path) -> None:
    """Put into a folder what the commands need: a filter, a class of two, a run, and a temporary folder."""
    (folder / "class").mkdir()
    (folder / "tmp").mkdir()
    for name in ("filter.py", "class/anna.py", "class/ben.py"):
        shutil.copy(ROOT / "examples/student_ekf.py", folder / name)
    shutil.copytree(given(), folder / "given")


@functools.cache
def given() -> Path:
    """Make the run that commands on stored results read."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder)
    (folder / "tmp").mkdir()
    run(("run", SCENARIO, "--estimators", "ekf", "--out", "run"), folder)
    run(("export", "run/recording.npz", "--format", "csv", "--out", "run/csv"), folder)
    return folder / "run"


def run(words: tuple[str, ...], folder: Path, way: str = "", moment: float = 0.0) -> Done:
    """Run a command in a folder, and end it in this way after `moment` [s].

    Raises:
        subprocess.TimeoutExpired: it did not end after the signals; it is killed then.
    """
    environment = {**os.environ, "TMPDIR": str(folder / "tmp"), "COLUMNS": "200"}
    output = folder / "tmp.log"
    with output.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "slamgauge", *words],
            cwd=folder,
            env=environment,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
        with suppress(subprocess.TimeoutExpired):
            process.wait(moment if way else None)
        for number in WAYS.get(way, ()):
            if way in GROUP and process.poll() is None:
                os.killpg(process.pid, number)
            else:
                process.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                process.wait(BETWEEN)
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    return Done(process.returncode, output.read_text(encoding="utf-8", errors="replace"), results(folder / "out"))


def results(folder: Path) -> dict[str, Any]:
    """Return the contents of the JSON and CSV files of a folder, without values that depend on the clock."""
    found: dict[str, Any] = {}
    for file in folder.rglob("*"):
        name = str(file.relative_to(folder))
        if file.suffix == ".json" and file.name not in (MARK, "bench.json"):
            found[name] = without_clock(json.loads(file.read_text()))
        elif file.suffix == ".csv":
            found[name] = without_clock([*csv.DictReader(file.read_text().splitlines())])
    return found


def without_clock(content: Any) -> Any:
    """Return content without the keys whose values depend on the clock."""
    if isinstance(content, dict):
        return {key: without_clock(value) for key, value in content.items() if not any(each in key for each in CLOCK)}
    return [without_clock(each) for each in content] if isinstance(content, list) else content


def left_processes(folder: Path) -> list[int]:
    """Return the processes whose environment names the folder, and that do not end soon."""
    deadline = time.monotonic() + FOLLOWING
    while (found := processes_of(folder)) and time.monotonic() < deadline:
        time.sleep(0.1)
    return found


def processes_of(folder: Path) -> list[int]:
    """Return the processes whose environment names a folder."""
    found: list[int] = []
    for each in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.fsencode(folder) in (each / "environ").read_bytes():
                found.append(int(each.name))
    return found


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
