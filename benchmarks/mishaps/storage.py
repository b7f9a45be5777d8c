"""No room for files, or no right to write them."""

from __future__ import annotations

import subprocess

from mishaps.machine import Machine, Tried, contents, left_clean

NO_ROOM, LITTLE_ROOM = 16, 256  # kB
BLOCK = 4096  # bytes, in which files take room
DIRECTORIES = 16  # kB
NAMESPACE = ("unshare", "--map-root-user", "--mount")
MOUNTED = ("full", "read-only")


def can_mount() -> bool:
    """Whether this user may mount something in a namespace of its own."""
    try:
        words = [*NAMESPACE, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
        return subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def limited(machine: Machine, name: str) -> Tried:
    """Files may be of so many bytes, and no more."""
    for room in (NO_ROOM // 4, LITTLE_ROOM // 4):
        out = machine.place()
        yield left_clean(machine.end(machine.start(machine.words(name, out), room)), out)


def full(machine: Machine, name: str) -> Tried:
    """A file system in memory with hardly any room beside what is in the folder already."""
    for room in (NO_ROOM, LITTLE_ROOM):
        out = machine.place()
        out.mkdir()
        words = machine.words(name, out)
        held = out.rename(out.with_name(f"{out.name}-held"))
        out.mkdir()
        before, left = contents(held), out.with_name(f"{out.name}-left")
        size = room + sum(-(-len(each) // BLOCK) * BLOCK for each in before.values()) // 1024 + DIRECTORIES
        mount = f'mount -t tmpfs -o size={size}k tmpfs "$0" && cp -r "$1/." "$0" && shift && ("$@")'
        look = 'status=$?; cp -r "$0" "$0-left"; exit $status'  # the mount is gone when this shell is
        outcome = machine.end(machine.start([*NAMESPACE, "sh", "-c", f"{mount}; {look}", str(out), str(held), *words]))
        is_changed = {name: contents(left).get(name) for name in before} != before
        yield "lost" if outcome == "refused" and is_changed else left_clean(outcome, left)


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
