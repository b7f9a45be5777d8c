"""Commands with some arguments replaced by invalid ones."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np

from fuzzing.mutations import WORDS
from fuzzing.targets import PARK, SCENARIO
from slamgauge import load_scenario, save, simulate
from slamgauge.compare.cli.main import main

ARGUMENTS = "arguments"
COMMANDS = (
    "evaluate r.npz --estimators ekf --set association.gate=9 association.method=jcbb",
    "evaluate r.npz --estimators dead-reckoning --robust gate --reach 10",
    "evaluate r.npz --estimates mine=e.csv --initialisation delayed",
    "import victoria-park p.txt --out p --max-range 5",
    "import csv p.txt --out c --set noise.forward=0.1",
    "import mrclam p --robot 1 --out m --turn 0.1",
    "import lost-in-the-woods p.txt --out w --lateral-slip 0.02",
    "export r.npz --format g2o --out g --lend 0.1",
    "export r.npz --format csv --out x",
    "scenarios q1-long-dense",
    "run s.toml --seed 0 --estimators ekf --timeout 5 --out run",
    "twin r.npz --out t",
    "run s.toml --set trajectory.duration=1.0 association.gate=9 --estimators dead-reckoning --out o",
    "study s.toml --runs 1 --seed 0 --jobs 1 --estimators dead-reckoning --set trajectory.duration=1.0 --out s",
    "study s.toml --runs 1 --jobs 1 --estimators dead-reckoning,ekf --against ekf --out p",
    "study s.toml --runs 1 --jobs 1 --estimators dead-reckoning --sweep association.gate=4,9 --out w",
    "budget s.toml --runs 1 --seed 0 --jobs 1 --filter ekf --set trajectory.duration=1.0 --out b",
    "bench --landmarks 5 --estimators dead-reckoning --out n",
)


def run_arguments(rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """Run a command with one or two words changed; return the outcome, and what it printed if that is wrong."""
    scenario = folder / "s.toml"
    scenario.write_text(SCENARIO)
    save(folder / "r.npz", simulate(load_scenario(scenario), 0)[1])
    (folder / "p.txt").write_text(PARK)
    words = str(rng.choice(COMMANDS)).split()
    for _ in range(rng.integers(1, 3)):
        words[int(rng.integers(1, len(words)))] = str(rng.choice(WORDS)).replace("\x00", "")
    errors = io.StringIO()
    try:
        with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
            status = main(words)
    except SystemExit as end:
        return ("refused in one line" if end.code == 2 else "accepted"), ""  # the argument parser prints a box
    if status in (0, 1):
        return "accepted", ""
    lines = [line for line in errors.getvalue().splitlines() if ": compiling " not in line]
    if status in (2, 71) and len(lines) == 1:
        return "refused in one line", ""
    return "traceback", f"{' '.join(words)!r:.150}: status {status}, {lines[-1:]!r:.200}"
