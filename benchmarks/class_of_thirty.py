"""Grade a class: right filters, filters with a bug, and six submissions that cannot be graded, by one command.

    python benchmarks/class_of_thirty.py [--graded 24] [--runs 20] [--scenario q1-long-dense] [--timeout 60] [--jobs 2]
        [--seed 0]

The files are made of those in `examples`, under names that are drawn. Six are as they should not be: a syntax error, a
loop without end, an `exit()`, 100 MB of prints, one that looks for truth.npz wherever it can, and one whose poses are
those of a step later. Prints the command's table, and how long it took; exit status 1 if other submissions than these
six have not been graded, or one of them for another reason.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

EXAMPLES = Path(__file__).parents[1] / "examples"
KINDS = ("right", "wrong_jacobian", "no_cross_covariance", "no_wrap", "own_noise")

LOOKS_FOR_THE_TRUTH = """
from pathlib import Path
import numpy as np
from slamgauge import Estimate

def estimate(recording):
    here = [Path.cwd(), Path.home(), Path(__file__).parent]
    for place in [*here, *here[0].parents[:2], *here[2].parents[:1]]:
        for path in place.rglob("truth.npz"):
            return Estimate("filtered", np.load(path)["poses"])
    raise FileNotFoundError("truth.npz")
"""
SHIFTED = """
from dataclasses import replace
import numpy as np
from slamgauge import riekf

def later(rows):
    return np.concatenate([rows[1:], rows[-1:]])

def estimate(recording):
    right = riekf(recording)
    return replace(right, poses=later(right.poses), pose_covs=later(right.pose_covs))
"""
UNGRADED = {  # content, and what the reason has to say
    "syntax_error": ("def ekf_slam(xEst, PEst, u, y)\n    return xEst, PEst\n", "SyntaxError"),
    "endless": ("def estimate(recording):\n    while True:\n        pass\n", "was not done after"),
    "exits": ("exit()\n\n\ndef ekf_slam(xEst, PEst, u, y):\n    return xEst, PEst\n", "SystemExit"),
    "floods": (
        "def estimate(recording):\n    for _ in range(100_000):\n        print('x' * 999)\n",
        "printed more than",
    ),
    "looks_for_the_truth": (LOOKS_FOR_THE_TRUTH, "FileNotFoundError"),
    "shifted": (SHIFTED, "uses the future"),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--graded", type=int, default=24, help="how many can be graded")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--scenario", default="q1-long-dense")
    parser.add_argument("--timeout", type=float, default=60.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of names and of the runs")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name) / "class", Path(name) / "out"
        folder.mkdir()
        (Path(name) / "tmp").mkdir()
        expected = write_class(folder, options.graded, random.Random(options.seed))
        words = {key: str(getattr(options, key)) for key in ("scenario", "runs", "timeout", "jobs", "seed")}
        command = [sys.executable, "-m", "slamgauge", "grade", str(folder), "--out", str(out)]
        command += [word for key, value in words.items() for word in (f"--{key}", value)]
        start = perf_counter()
        done = subprocess.run(command, env={**os.environ, "TMPDIR": f"{name}/tmp"}, stdout=subprocess.PIPE, text=True)
        seconds = perf_counter() - start
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(done.stdout)
        wrong = mistakes(out / "grades.csv", expected) if done.returncode == 1 else [f"exit status {done.returncode}"]
    print("\n".join(wrong) or f"{options.graded} graded, {len(expected)} named with their reasons")
    print(f"{seconds:.0f} s, {used.ru_utime + used.ru_stime:.0f} s of processors, {options.jobs} jobs")
    return 1 if wrong else 0


def write_class(folder: Path, graded: int, rng: random.Random) -> dict[str, str]:
    """Write the submissions; the names of those that cannot be graded, and what the reason has to say."""
    names = [f"student_{number:02d}" for number in range(1, graded + len(UNGRADED) + 1)]
    rng.shuffle(names)
    for number, name in enumerate(names[len(UNGRADED) :]):
        kind = KINDS[number % len(KINDS)]
        source = EXAMPLES / ("student_ekf.py" if kind in ("right", "own_noise") else f"student_ekf_{kind}.py")
        content = source.read_text(encoding="utf-8")
        if kind == "own_noise":
            factor = rng.uniform(0.5, 2.0)
            own = 'estimate = adapters.step_function(ekf_slam, noise="file")'
            content += f"\n\nfrom slamgauge import adapters\n\nQ *= {factor}\n{own}\n"
        (folder / f"{name}.py").write_text(content, encoding="utf-8")
    for name, (content, _) in zip(names, UNGRADED.values(), strict=False):
        (folder / f"{name}.py").write_text(content, encoding="utf-8")
    return {name: reason for name, (_, reason) in zip(names, UNGRADED.values(), strict=False)}


def mistakes(path: Path, expected: dict[str, str]) -> list[str]:
    """What grades.csv should not say."""
    with path.open(encoding="utf-8", newline="") as file:
        reasons = {row["submission"]: row["reason"] for row in csv.DictReader(file) if row["graded"] == "false"}
    found = [f"{name} is not graded: {reason}" for name, reason in reasons.items() if name not in expected]
    found += [f"{name} is graded" for name in expected if name not in reasons]
    return found + [
        f"{name}: {reasons[name]}"
        for name, reason in expected.items()
        if name in reasons and reason not in reasons[name]
    ]


if __name__ == "__main__":
    sys.exit(main())
