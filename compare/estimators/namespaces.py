"""Namespaces of Linux by system call: a process that sees other folders and processes, and no network.

Only the standard library is imported, so that `python -I -S namespaces.py` quickly shows whether the system permits
them (status 0). Sources: the manual pages unshare(2), user_namespaces(7), pivot_root(2), mount_setattr(2), capset(2).
"""

from __future__ import annotations

import ctypes
import os
import signal
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

NEW_USER, NEW_MOUNTS, NEW_PIDS, NEW_IPC, NEW_NAMES, NEW_NETWORK = 1 << 28, 1 << 17, 1 << 29, 1 << 27, 1 << 26, 1 << 30
ALL = NEW_USER | NEW_MOUNTS | NEW_PIDS | NEW_IPC | NEW_NAMES | NEW_NETWORK
READ_ONLY, NO_SUID, NO_DEVICES, NO_EXECUTION, BIND, RECURSIVE, SLAVE = 1, 2, 4, 8, 1 << 12, 1 << 14, 1 << 19
REMOUNT, DETACH = 1 << 5, 2
MOUNT_SETATTR, FROM_HERE, WHOLE_TREE = 442, -100, 0x8000  # number of the system call on every processor
KEEP_CAPABILITIES, DEATH_SIGNAL, DROP_BOUND, NO_NEW_PRIVILEGES, AMBIENT = 8, 1, 24, 38, 47
READ_ALL = 2  # the capability CAP_DAC_READ_SEARCH
CAPABILITIES_3 = 0x20080522
NOBODY = 65534
SIGNALLED = 128  # added to the number of the signal in the status of a process, as shells do

_libc = ctypes.CDLL(None, use_errno=True)


def _checked(result: int, what: str) -> None:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def control(option: int, *values: int) -> int:
    """Set a property of this process, as prctl(2) does."""
    return _libc.prctl(option, *(ctypes.c_ulong(each) for each in (*values, 0, 0, 0, 0)[:4]))


def mount(source: str | Path, target: str | Path, kind: str = "", flags: int = 0, data: str = "") -> None:
    """Mount a file system or, with `BIND`, a folder or file.

    Raises:
        OSError: the system refuses it.
    """
    _checked(
        _libc.mount(os.fsencode(source), os.fsencode(target), kind.encode(), ctypes.c_ulong(flags), data.encode()),
        f"mount {target}",
    )


def show(source: Path, target: Path) -> None:
    """Mount a file, or a folder with all mounts in it, read-only at an existing target.

    Raises:
        OSError: the system refuses it.
    """
    mount(source, target, flags=BIND | RECURSIVE)
    attributes = struct.pack("QQQQ", READ_ONLY | NO_SUID | NO_DEVICES, 0, 0, 0)
    result = _libc.syscall(MOUNT_SETATTR, FROM_HERE, os.fsencode(target), WHOLE_TREE, attributes, len(attributes))
    _checked(result, f"read-only mount of {target}")


def enter_root(folder: str, old: str) -> None:
    """Make a mounted folder the root; the old root appears at `old` in it, or nowhere if `old` is empty.

    Raises:
        OSError: the system refuses it.
    """
    os.chdir(folder)
    _checked(_libc.pivot_root(b".", os.fsencode(old or ".")), "new root")
    if not old:
        _checked(_libc.umount2(b".", DETACH), "end of the old root")
    os.chdir("/")


def forked(work: Callable[[], None], output: int) -> int:
    """Fork a process that leads a process group, writes to the file `output`, does the work and ends.

    It ends with this process, too, where the system can do that (Linux). Returns its number.
    """
    pid = os.fork()
    with suppress(OSError):  # both do it, so that the group exists for both
        os.setpgid(pid, 0)
    if not pid:
        _follow_parent()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        work_and_end(work)
    return pid


def forked_apart(inside: Callable[[], None], output: int) -> int:
    """Fork a process in new namespaces, as `forked`, where a first process calls `inside` with all capabilities there.

    The forked process is outside the new process namespace, and its status is that of the first process. Whatever
    `inside` starts ends with it.
    """
    (waits, ready), (mapped, done) = os.pipe(), os.pipe()

    def lead() -> None:
        os.close(waits)
        os.close(done)
        _lead(ready, mapped, inside)

    pid = forked(lead, output)
    os.close(ready)
    os.close(mapped)
    with os.fdopen(waits, "rb") as started, os.fdopen(done, "wb") as answer:
        if started.read(1):
            _map_users(pid)
            answer.write(b"+")
    return pid


def _lead(ready: int, mapped: int, inside: Callable[[], None]) -> None:
    _checked(_libc.unshare(ALL), "new namespaces")
    os.write(ready, b"+")
    os.close(ready)
    if not os.read(mapped, 1):
        raise OSError("no users could be mapped")
    with suppress(OSError):  # namespaces within these would give capabilities again
        Path("/proc/sys/user/max_user_namespaces").write_text("0", encoding="ascii")
    first = os.fork()
    if not first:
        _follow_parent()  # the end of the first process ends all others of its namespace
        work_and_end(inside)
    end_with(first)


def end_with(child: int) -> None:
    """Close all files, wait for a child process, and end with its status."""
    os.closerange(0, 4096)
    while True:
        pid, status = os.wait()
        if pid == child:
            os._exit(os.WEXITSTATUS(status) if os.WIFEXITED(status) else SIGNALLED + os.WTERMSIG(status))


def _follow_parent() -> None:
    if sys.platform.startswith("linux"):
        control(DEATH_SIGNAL, signal.SIGKILL)


def work_and_end(work: Callable[[], None]) -> None:
    """Do the work and end this process, which never returns to the code of its parent."""
    try:
        work()
        os._exit(0)
    except BaseException as error:  # noqa: BLE001 it is reported, and nothing follows
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
    finally:
        os._exit(1)


def _map_users(pid: int) -> None:
    """Give the users of this namespace the same numbers in that of the process; without privileges only this user."""
    folder, is_root = Path(f"/proc/{pid}"), os.geteuid() == 0
    for name, ours in (("uid_map", os.geteuid()), ("gid_map", os.getegid())):
        ranges = [line.split() for line in Path("/proc/self", name).read_text(encoding="ascii").splitlines()]
        lines = [f"{first} {first} {count}" for first, _, count in ranges] if is_root else [f"{ours} {ours} 1"]
        if not is_root and name == "gid_map":
            (folder / "setgroups").write_text("deny", encoding="ascii")
        (folder / name).write_text("\n".join(lines) + "\n", encoding="ascii")


def drop_privileges() -> None:
    """Give up all capabilities, forever; root becomes the user `nobody`, who may read all files that it sees.

    Raises:
        OSError: the system refuses it.
    """
    kept = [READ_ALL] if os.geteuid() == 0 else []
    for each in range(64):
        if each not in kept:
            control(DROP_BOUND, each)
    if kept:
        control(KEEP_CAPABILITIES, 1)
        os.setgroups([])
        os.setresgid(NOBODY, NOBODY, NOBODY)
        os.setresuid(NOBODY, NOBODY, NOBODY)
    mask = sum(1 << each for each in kept)
    header, sets = struct.pack("=Ii", CAPABILITIES_3, 0), struct.pack("=6I", mask, mask, mask, 0, 0, 0)
    _checked(_libc.capset(header, sets), "end of capabilities")
    for each in kept:
        control(AMBIENT, 2, each)  # programs that it starts have it, too
    control(NO_NEW_PRIVILEGES, 1)


def set_host_name(name: str) -> None:
    """Name the machine in this namespace."""
    _checked(_libc.sethostname(name.encode(), len(name)), "name of the machine")


def _try() -> None:
    """Mount a folder and the processes of the new namespace; an error ends this process with status 1."""
    mount("none", "/", flags=RECURSIVE | SLAVE)
    mount("tmpfs", "/tmp", "tmpfs")
    Path("/tmp/usr").mkdir()
    show(Path("/usr"), Path("/tmp/usr"))
    mount("proc", "/tmp", "proc", READ_ONLY)
    drop_privileges()
    os._exit(0)


if __name__ == "__main__":
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(forked_apart(_try, 2), 0)[1]))
