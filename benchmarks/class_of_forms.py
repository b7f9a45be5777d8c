"""Grade a class of 40 made-up files, and print the verdict of each and the processor time.

    python benchmarks/class_of_forms.py [--runs 8] [--only ""] [--timeout 20]

The files have five forms of user code, each right and with six seeded bugs; five more files crash, hang, print, exit
and cheat. `--only` selects rows by the beginning of their text, for example "online class: right". The exit status is
1 if a right file does not pass, or if a file that crashes, hangs, exits or cheats does. The last line counts the bugs
that pass. The processor time is that of `slamgauge grade` with all its processes.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import tyro

sys.path.insert(0, str(Path(__file__).parent))  # Python with PYTHONSAFEPATH does not look there

from references.class_files import submissions

SCENARIO = "q1-short-dense"
RIGHT = {("misbehaving", "prints")}  # a right filter, too


def main(runs: int = 8, only: str = "", timeout: float = 20.0) -> int:
    files = {key: text for key, text in submissions().items() if ": ".join(key).startswith(only)}
    with tempfile.TemporaryDirectory() as folder:
        rows, seconds = graded(Path(folder), files, runs, timeout)
    good, missed = True, 0
    print(f"{'form':22}{'file':18}{'passed':>7}{'points':>8}  {'reason'}")
    for key, row in zip(files, rows, strict=True):
        is_right = key[1] == "right" or key in RIGHT
        is_bug = key[0] != "misbehaving" and not is_right
        missed += is_bug and row["passed"]
        good = good and (is_bug or row["passed"] == is_right)
        mark = "yes" if row["passed"] else "no"
        print(f"{key[0]:22}{key[1]:18}{mark:>7}{row.get('points', '-'):>8}  {row['reason'][:90]}")
    print(f"{len(files)} files, {runs} runs of {SCENARIO}: {seconds:.0f} s of processor time, {missed} bugs pass")
    return 0 if good else 1


def graded(folder: Path, files: dict[tuple[str, str], str], runs: int, timeout: float) -> tuple[list[dict], float]:
    """Write the files, grade them, and return a row for each and the processor time [s]."""
    (folder / "class").mkdir()
    for number, text in enumerate(files.values()):
        (folder / "class" / f"s{number:02}.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "slamgauge", "grade", "class", "--scenario", SCENARIO, "--json", "--no-report"]
    command += ["--runs", str(runs), "--seed", "0", "--timeout", str(timeout)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if not done.stdout.strip():
        raise SystemExit(f"slamgauge grade ended with status {done.returncode} and printed nothing")
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout), spent


if __name__ == "__main__":
    sys.exit(tyro.cli(main, description=__doc__))
