"""The commands that are tried, at their smallest sizes, and what they are given."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SHORT = ("--set", "trajectory.duration=3")
STUDY = ("study", "q1-long-dense", *SHORT, "--jobs", "2", "--estimators", "ekf,causal")
COMMANDS = {
    "run": ("run", "q1-short-dense", *SHORT, "--estimators", "ekf,causal"),
    "evaluate": ("evaluate", "INPUT/recording.npz", "--estimators", "ekf"),
    "import": ("import", "csv", "INPUT/csv"),
    "export": ("export", "INPUT", "--format", "csv"),
    "twin": ("twin", "INPUT/recording.npz"),
    "study": (*STUDY, "--runs", "2"),
    "sweep": (*STUDY, "--runs", "2", "--sweep", "association.gate=4,9"),
    "budget": ("budget", "q1-long-dense", *SHORT, "--runs", "2", "--jobs", "1"),
    "claims": ("claims", "--runs", "2", "--max-runs", "2", "--jobs", "2"),
    "noise": ("noise", "INPUT/recording.npz"),
    "bench": ("bench", "--landmarks", "5", "--estimators", "dead-reckoning"),
    "grade": ("grade", "INPUT/class", "--scenario", "q1-short-dense", "--runs", "2", "--jobs", "1"),
    "animate": ("animate", "OUT", "--seconds", "1", "--fps", "2"),
    "report": ("report", "OUT"),
    "check": ("check", "ekf"),
}
SILENT = ("check",)  # writes no files


def make_input(parent: Path) -> None:
    """A run, its recording as CSV, and a class of one."""
    folder = parent / "input"
    for words in (COMMANDS["run"], ("export", str(folder), "--format", "csv")):
        out = folder / "csv" if words[0] == "export" else folder
        subprocess.run([sys.executable, "-m", "slamgauge", *words, "--out", str(out)], check=True, capture_output=True)
    (folder / "class").mkdir()
    (folder / "class/dead.py").write_text("from slamgauge import dead_reckoning as estimate\n", encoding="utf-8")
