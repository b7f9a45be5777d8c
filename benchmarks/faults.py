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
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # Python may be told not to look there

from mishaps.commands import COMMANDS, make_input
from mishaps.foreign_files import foreign
from mishaps.machine import OUTCOMES, Machine, Tried, keep_bytecode
from mishaps.processes import dead_scheduler, dead_worker, killed, two_at_once
from mishaps.storage import MOUNTED, can_mount, full, limited, read_only

from slamgauge.compare.scoring.text_table import aligned

EVERY = ("kill", "limit", "full", "read-only", "two-at-once", "worker", "scheduler", "foreign")


def main() -> int:
    names = tuple(COMMANDS)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", default=",".join(EVERY))
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
        keep_bytecode()
        make_input(machine.folder)
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


if __name__ == "__main__":
    sys.exit(main())
