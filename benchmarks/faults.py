"""Kill commands, fill their disks, take away their folders and their workers, and see what is lost and what is said.

    python benchmarks/faults.py [--faults kill,full,...] [--commands run,study,...] [--kills 20] [--foreign 1000]
        [--seed 0] [--timeout 300]

A row for each fault and command: how often it was tried, and what came of it: done (exit status 0), refused (in lines
that say what and where, another exit status), a traceback, a hang (killed after --timeout seconds), a crash (ended
by a signal that nobody sent), and lost: whatever had been there before, or been stored, is not there afterwards, or
partial folders are left behind. A command that we kill is done if it ends by that; the one after the last kill has to
make all whole, as an undisturbed one has. Exit status 1 if a traceback, a hang, a crash or a loss is among them. What
the machine does not allow (mounts need a user namespace or root, the scheduler needs dask's) is a line `skipped`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from slamgauge.compare.scoring.text_table import aligned

SHORT = ("--set", "trajectory.duration=3")
STUDY = ("study", "q1-long-dense", *SHORT, "--jobs", "2", "--estimators", "ekf,isam2")
COMMANDS = {
    "run": ("run", "q1-short-dense", *SHORT, "--estimators", "ekf,isam2"),
    "evaluate": ("evaluate", "INPUT/recording.npz", "--estimators", "ekf"),
    "import": ("import", "csv", "INPUT/csv"),
    "export": ("export", "INPUT", "--format", "csv"),
    "twin": ("twin", "INPUT/recording.npz"),
    "study": (*STUDY, "--runs", "2"),
    "sweep": (*STUDY, "--runs", "2", "--sweep", "association.gate=4,9"),
    "budget": ("budget", "q1-long-dense", *SHORT, "--runs", "2", "--jobs", "1"),
    "claims": ("claims", "--runs", "2", "--jobs", "2"),
    "noise": ("noise", "INPUT/recording.npz"),
    "bench": ("bench", "--landmarks", "5", "--estimators", "dead-reckoning"),
    "grade": ("grade", "INPUT/class", "--scenario", "q1-short-dense", "--runs", "2", "--jobs", "1"),
    "animate": ("animate", "OUT", "--seconds", "1", "--fps", "2"),
}
OUTCOMES = ("done", "refused", "traceback", "hang", "crash", "lost")
NO_ROOM, LITTLE_ROOM = 16, 256  # kB
UNLUCKY = (  # as ours, nearly as ours, or as no program likes them
    *(
        "figure.png~",
        "metrics.json.bak",
        ".slamgauge.0badcafe.partial/owner",
        ".slamgauge.json.partial",
        "study.sqlite2",
    ),
    *("estimates/mine.npz", "trajectories/gps.tum", "association.gate=9/notes", "optimum/notes", "studies/notes"),
    *("-rf", "~", "$HOME", "`id`", "a\nb", "bad\udcff", "<b>&amp;.html", "submissions/me.md", "CON", " ", "%s%n", "*"),
)


@dataclass
class Machine:
    """Where commands are run, and how long each may take."""

    folder: Path
    timeout: float
    runs: int = 0

    def place(self) -> Path:
        """A new folder to write into."""
        self.runs += 1
        return self.folder / f"out{self.runs}"

    def words(self, name: str, out: Path) -> list[str]:
        """The command, writing into `out`, which for an animation holds a run."""
        words = [word.replace("INPUT", str(self.folder / "input")) for word in COMMANDS[name]]
        if name == "animate":
            shutil.copytree(self.folder / "input", out, dirs_exist_ok=True)
            words = [word.replace("OUT", str(out)) for word in words]
        else:
            words += ["--out", str(out)]
        return [sys.executable, "-m", "slamgauge", *words]

    def start(self, words: list[str], room: int | None = None) -> subprocess.Popen[str]:
        """Start a command, which may write files of so many kB."""

        def limit() -> None:
            if room is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (room * 1024, room * 1024))

        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "errors": "replace"}
        return subprocess.Popen(words, cwd=self.folder, preexec_fn=limit, **pipes)  # pyright: ignore[reportArgumentType, reportCallIssue]

    def end(self, process: subprocess.Popen[str], sent: int = 0) -> str:
        """What came of it, where we have sent this signal."""
        try:
            _, said = process.communicate(timeout=self.timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return "hang"
        if "Traceback" in said or process.returncode == 70:
            print(said, file=sys.stderr)
            return "traceback"
        if process.returncode < 0 or process.returncode >= 128:
            return "done" if -process.returncode == sent or process.returncode == 128 + sent else "crash"
        return "refused" if process.returncode else "done"


Tried = Generator[str]  # an outcome for each time


def killed(machine: Machine, name: str, kills: int, moments: random.Random) -> Tried:
    """SIGKILL at a random moment of as long as it takes; what is stored stays, and the next command makes it whole."""
    begun = time.monotonic()
    calm = machine.place()
    machine.end(machine.start(machine.words(name, calm)))
    seconds, out = time.monotonic() - begun, machine.place()
    for _ in range(kills):
        process = machine.start(machine.words(name, out))
        time.sleep(moments.uniform(0.0, seconds))
        process.kill()
        yield machine.end(process, signal.SIGKILL)
    outcome = machine.end(machine.start(machine.words(name, out)))
    yield outcome if outcome != "done" or is_same(calm, out) else "lost"


def is_same(calm: Path, out: Path) -> bool:
    """Whether the folder is whole, as that of an undisturbed command, and nothing lies beside it."""
    names = [{path.relative_to(each).as_posix() for path in each.rglob("*")} for each in (calm, out)]
    left = [*out.parent.glob(".slamgauge.*.partial"), *out.glob(".slamgauge.*.partial")]
    return names[0] == names[1] and not left and all(figures(calm, each) == figures(out, each) for each in names[0])


def figures(folder: Path, name: str) -> object:
    """A JSON file without computing times and places; nothing of other files."""
    if not name.endswith(".json") or name.startswith("."):
        return None

    def without(value: object) -> object:
        if isinstance(value, dict):
            return {key: without(each) for key, each in value.items() if "seconds" not in key and key != "command"}
        return [without(each) for each in value] if isinstance(value, list) else value

    return without(json.loads((folder / name).read_text(encoding="utf-8")))


def limited(machine: Machine, name: str) -> Tried:
    """Files may be of so many bytes, and no more."""
    for room in (NO_ROOM // 4, LITTLE_ROOM // 4):
        out = machine.place()
        yield left_clean(machine.end(machine.start(machine.words(name, out), room)), out)


def full(machine: Machine, name: str) -> Tried:
    """A file system in memory with hardly any room."""
    for room in (NO_ROOM, LITTLE_ROOM):
        out = machine.place()
        out.mkdir()
        mount = f'mount -t tmpfs -o size={room}k tmpfs "$0" && exec "$@"'
        yield machine.end(machine.start([*NAMESPACE, "sh", "-c", mount, str(out), *machine.words(name, out)]))


def read_only(machine: Machine, name: str) -> Tried:
    """A folder, new and with results in it, on a file system that is mounted for reading."""
    out = machine.place()
    out.mkdir()
    for _ in range(2):
        words = machine.words(name, out)
        before = contents(out)
        mount = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" && exec "$@"'
        outcome = machine.end(machine.start([*NAMESPACE, "sh", "-c", mount, str(out), *words]))
        yield outcome if contents(out) == before else "lost"
        machine.end(machine.start(words))


def left_clean(outcome: str, out: Path) -> str:
    """The outcome, unless partial folders are left."""
    return "lost" if [*out.parent.glob(".slamgauge.*.partial"), *out.glob("**/.slamgauge.*.partial")] else outcome


def two_at_once(machine: Machine, name: str) -> Tried:
    """The same command twice into one folder; afterwards it holds one whole result."""
    calm, out = machine.place(), machine.place()
    machine.end(machine.start(machine.words(name, calm)))
    processes = [machine.start(machine.words(name, out)) for _ in range(2)]
    outcomes = [machine.end(process) for process in processes]
    yield outcomes[0]
    yield outcomes[1] if is_same(calm, out) and "done" in outcomes else "lost"


def dead_worker(machine: Machine, name: str) -> Tried:
    """SIGKILL to the first process that carries runs; they are carried out all the same."""
    calm, out = machine.place(), machine.place()
    machine.end(machine.start(machine.words(name, calm)))
    process = machine.start(machine.words(name, out))
    found: list[int] = []
    while process.poll() is None and not found:
        found = workers(process.pid)
        time.sleep(0.02)
    for worker in found[:1]:
        os.kill(worker, signal.SIGKILL)
    outcome = machine.end(process)
    yield outcome if outcome != "done" or is_same(calm, out) else "lost"


def dead_scheduler(machine: Machine, name: str) -> Tried:
    """SIGKILL to the Dask scheduler while its worker carries the runs; later the same command goes on without it."""
    out, file = machine.place(), machine.folder / "scheduler.json"
    program = [sys.executable, "-m"]
    place = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = machine.start(
        [*program, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *place]
    )
    worker = machine.start([*program, "distributed.cli.dask_worker", "--nthreads", "1", *place])
    begun = time.monotonic()
    while not file.exists() and time.monotonic() - begun < machine.timeout:
        time.sleep(0.1)
    address = json.loads(file.read_text(encoding="utf-8"))["address"]
    process = machine.start([*machine.words(name, out), "--runs", "10000", "--scheduler", address])
    store = out / "study.sqlite-wal"
    while process.poll() is None and not (store.exists() and store.stat().st_size > 100_000):
        time.sleep(0.1)
    for each in (scheduler, worker):
        each.kill()
        each.communicate()
    yield machine.end(process)
    yield machine.end(machine.start(machine.words(name, out)))


def workers(parent: int) -> list[int]:
    """Children of a process that have been spawned to carry runs."""
    listed = Path(f"/proc/{parent}/task/{parent}/children")
    children = [int(word) for word in listed.read_text().split()] if listed.exists() else []
    return [each for each in children if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()]


def foreign(machine: Machine, name: str, count: int, contents_of: random.Random) -> Tried:
    """A folder with files of others whose names are unlucky: whatever the command says, they stay as they are."""
    out = machine.place()
    words = machine.words(name, out)
    for number in range(count):
        unlucky = UNLUCKY[number % len(UNLUCKY)]
        path = out / (unlucky if number < len(UNLUCKY) else f"{unlucky} {number}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(contents_of.randbytes(64))
    before = contents(out)
    for _ in range(2):
        outcome = machine.end(machine.start(words))
        after = contents(out)
        yield outcome if {each: after.get(each) for each in before} == before else "lost"


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, but what slamgauge's own list says of them."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".slamgauge.json"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


NAMESPACE = ("unshare", "--map-root-user", "--mount")
MOUNTED = ("full", "read-only")


def can_mount() -> bool:
    """Whether this user may mount something in a namespace of its own."""
    try:
        words = [*NAMESPACE, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
        return subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def main() -> int:
    names, every = (
        tuple(COMMANDS),
        ("kill", "limit", "full", "read-only", "two-at-once", "worker", "scheduler", "foreign"),
    )
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", default=",".join(every))
    parser.add_argument("--commands", default=",".join(names))
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--foreign", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timeout", type=float, default=300.0)
    options = parser.parse_args()
    moments = random.Random(options.seed)
    rows: list[tuple[str, ...]] = [("fault", "command", "tried", *OUTCOMES)]
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        machine = Machine(Path(folder).resolve(), options.timeout)
        make_input(machine)
        faults: dict[str, Callable[[str], Tried]] = {
            "kill": lambda name: killed(machine, name, options.kills, moments),
            "limit": lambda name: limited(machine, name),
            "full": lambda name: full(machine, name),
            "read-only": lambda name: read_only(machine, name),
            "two-at-once": lambda name: two_at_once(machine, name),
            "worker": lambda name: dead_worker(machine, name),
            "scheduler": lambda name: dead_scheduler(machine, name),
            "foreign": lambda name: foreign(machine, name, options.foreign, moments),
        }
        only = {"two-at-once": ("run", "study", "budget"), "worker": ("study", "sweep"), "scheduler": ("study",)}
        only["kill"] = ("run", "study")
        for fault in options.faults.split(","):
            if (fault in MOUNTED and not can_mount()) or (fault == "scheduler" and find_spec("distributed") is None):
                print(f"skipped: {fault}, which this machine does not allow", flush=True)
                continue
            for name in (each for each in options.commands.split(",") if each in only.get(fault, names)):
                found = Counter(faults[fault](name))
                bad += sum(found[each] for each in OUTCOMES[2:])
                rows.append((fault, name, str(found.total()), *(str(found[each]) for each in OUTCOMES)))
                print(*rows[-1], file=sys.stderr, flush=True)
    print("\n".join(aligned(rows, words=2)))
    print(f"tracebacks, hangs, crashes and losses: {bad}")
    return 1 if bad else 0


def make_input(machine: Machine) -> None:
    """A run, its recording as CSV, and a class of one."""
    folder = machine.folder / "input"
    for words in (COMMANDS["run"], ("export", str(folder), "--format", "csv")):
        out = folder / "csv" if words[0] == "export" else folder
        subprocess.run([sys.executable, "-m", "slamgauge", *words, "--out", str(out)], check=True, capture_output=True)
    (folder / "class").mkdir()
    (folder / "class/dead.py").write_text("from slamgauge import dead_reckoning as estimate\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
