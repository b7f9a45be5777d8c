"""A command is run; what it says, and what it leaves."""

from __future__ import annotations

import compileall
import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Generator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mishaps.commands import COMMANDS, SILENT

OUTCOMES = ("done", "refused", "traceback", "hang", "crash", "lost")


def keep_bytecode() -> None:
    """Compile all: where it has no room Python leaves bytecode that is cut, and does not start from that again."""
    for floor in ("slamgauge", "slamgauge.compare", "slamgauge.ekf", "slamgauge.graph_baseline"):
        for folder in import_module(floor).__path__:
            compileall.compile_dir(folder, quiet=1)


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
        """The command, writing into `out`, which for those that explain a run holds one."""
        words = [word.replace("INPUT", str(self.folder / "input")) for word in COMMANDS[name]]
        if "OUT" in words:
            shutil.copytree(self.folder / "input", out, dirs_exist_ok=True)
            words = [word.replace("OUT", str(out)) for word in words]
        elif name not in SILENT:
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


def left_clean(outcome: str, out: Path) -> str:
    """The outcome, unless partial folders are left."""
    return "lost" if [*out.parent.glob(".slamgauge.*.partial"), *out.glob("**/.slamgauge.*.partial")] else outcome


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, but what slamgauge's own list says of them."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".slamgauge.json"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
