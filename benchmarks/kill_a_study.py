"""Kill a study with SIGKILL at random moments, start it again each time, and compare with an undisturbed one.

    python benchmarks/kill_a_study.py [--runs 40] [--kills 10] [--seed 0] [--jobs 2]

A kill comes up to 0.05 s after a random number of further runs has been stored, none among them. Prints how
many runs were stored at each kill; exit status 1 if the summaries differ (computing times apart) or a row
is missing or double.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

STUDY = ["q1-long-dense", "--estimators", "ekf,riekf"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        calm, killed = Path(folder) / "calm", Path(folder) / "killed"
        start_study(calm, options.runs, options.jobs).wait()
        moments = random.Random(options.seed)
        for left in range(options.kills, 0, -1):
            before = stored(killed)
            target = before + moments.randint(0, 2 * (options.runs - before) // (left + 1))
            process = start_study(killed, options.runs, options.jobs)
            while stored(killed) < target and process.poll() is None:
                time.sleep(0.005)
            time.sleep(moments.uniform(0.0, 0.05))
            process.send_signal(signal.SIGKILL)
            process.wait()
            print(f"killed with {stored(killed)} of {options.runs} runs stored", flush=True)
        if start_study(killed, options.runs, options.jobs).wait() != 0:
            return 1
        same = summary(killed) == summary(calm)
        rows = stored(killed)
    print(f"{'the same' if same else 'ANOTHER'} summary after {options.kills} kills; {rows} runs stored")
    return 0 if same and rows == options.runs else 1


def start_study(out: Path, runs: int, jobs: int) -> subprocess.Popen[bytes]:
    size = ["--runs", str(runs), "--jobs", str(jobs)]
    command = [sys.executable, "-m", "slamgauge", "study", *STUDY, *size, "--out", str(out)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def stored(out: Path) -> int:
    """Number of runs in the store; a run that is not whole, or double, raises."""
    if not (out / "study.sqlite").exists():
        return 0
    connection = sqlite3.connect(out / "study.sqlite")
    try:
        rows = list(connection.execute("SELECT run, estimator FROM outcome"))
    except sqlite3.OperationalError:  # killed before the table was made
        return 0
    finally:
        connection.close()
    runs = {run for run, _ in rows}
    assert sorted(rows) == sorted((run, name) for run in runs for name in ("ekf", "riekf"))
    return len(runs)


def summary(out: Path) -> dict[str, Any]:
    """summary.json without computing times, and without the command, which names the folder."""
    content = json.loads((out / "summary.json").read_text())
    del content["command"]
    for entry in content["estimators"].values():
        del entry["seconds_total"]
    return content


if __name__ == "__main__":
    sys.exit(main())
