"""SIGKILL to a command, to its workers and to its scheduler; two of it at once."""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

from mishaps.machine import Machine, Tried, is_same


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
