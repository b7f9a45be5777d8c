"""The wall around user code: `bwrap` (Debian's package bubblewrap) shows it its own files and the system's programs.

Its root contains the system's programs, Python with its libraries, slamgauge and a copy of the folder of the user's
file, all read-only. `/tmp`, `/dev/shm` and its home are writable, and empty before every run. It sees no other process
and no network, and ends with slamgauge. Where root builds the wall, the code runs as another user: no limit counts the
processes of root.
"""

from __future__ import annotations

import os
import site
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from slamgauge.errors import UserError

HOME, CODE = "/slamgauge", "/slamgauge-code"  # behind the wall: home and temporary folder, and the folder of the code
WRITABLE = ("/tmp", "/dev/shm", HOME)
ROOM = 500_000_000  # bytes of each writable folder
LIMITS = {  # limits of each process
    "FSIZE": 500_000_000,  # bytes of a file
    "DATA": 4_000_000_000,  # bytes: ten times what all libraries, filters and optima of slamgauge need together
    "NPROC": 256,
    "NOFILE": 1024,
}
SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/opt", "/nix", "/gnu")
SETTINGS = ("alternatives", "fonts", "group", "ld.so.*", "localtime", "nsswitch.conf", "octave*", "passwd")  # in /etc
SERVICES = range(61184, 65520)  # user ids of short-lived services (systemd's): no person and no file has one
BWRAP = ("bwrap", "--die-with-parent", "--new-session", "--hostname", "wall", "--cap-drop", "ALL")
APART = ("--unshare-all", "--unshare-user", "--disable-userns", "--uid", "65534", "--gid", "65534")  # no rights
APART_AS_ROOT = ("--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts", "--unshare-cgroup-try")
CHANGES_USER = ("--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID")
KEPT = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "LANG", "LANGUAGE", "TZ", "SSL_CERT_FILE")
KEPT_BEGINNINGS = ("LC_", "LD_", "NUMBA_", "OPENBLAS_", "MKL_", "OMP_", "KMP_", "VECLIB_")
CACHES = "/slamgauge-caches"  # behind the wall: compiled code and fonts, which every run finds in its home


def require_wall() -> None:
    """Refuse user code where this system can build no wall around it.

    Raises:
        UserError: with the remedy.
    """
    if not has_wall():
        why = "user code could read and change your files"
        remedy = "install Debian's package bubblewrap, or give --unconfined where a container is the wall"
        raise UserError(f"bwrap is missing, or this system does not permit it, so {why}; {remedy}")


@cache
def has_wall() -> bool:
    """Return whether this system has bwrap, and permits it."""
    with suppress(OSError, subprocess.TimeoutExpired):
        command = _bwrap("--ro-bind", "/", "/", "--proc", "/proc", command=["true"])
        return not subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=30.0).returncode
    return False


def _bwrap(*words: str, command: list[str]) -> list[str]:
    """Return a command that runs behind a wall of these words, and never as root."""
    if not hasattr(os, "geteuid") or os.geteuid():
        return [*BWRAP, *APART, *words, "--", *command]
    user = str(SERVICES[os.getpid() % len(SERVICES)])
    change = ["setpriv", "--reuid", user, "--regid", user, "--clear-groups"]
    return [*BWRAP, *APART_AS_ROOT, *CHANGES_USER, *words, "--", *change, *command]


def walled(command: list[str], code: Path | None) -> list[str]:
    """Return a command that runs behind the wall, with a folder of code at `CODE`."""
    words = ["--proc", "/proc", "--dev", "/dev"]
    for path in WRITABLE:
        words += ["--perms", "1777", "--size", str(ROOM), "--tmpfs", path]
    mounts = {path: path for path in _shown()} | {Path(CACHES, place): each for place, each in _caches().items()}
    if code is not None:
        mounts[Path(CODE)] = code
    for path in sorted({parent for each in mounts for parent in each.parents}):
        words += ["--perms", "755", "--dir", str(path)]  # bwrap would make them for its own user only
    for path, given in mounts.items():
        words += ["--ro-bind", str(given), str(path)]
    return _bwrap(*words, "--remount-ro", "/", "--chdir", HOME, command=command)


def environment(ours: Mapping[str, str]) -> dict[str, str]:
    """Return the environment behind the wall: the places of libraries, and private folders."""
    kept = {name: value for name, value in ours.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    own = {"HOME": HOME, "TMPDIR": HOME, "PWD": HOME, "XDG_CACHE_HOME": f"{HOME}/.cache", "MPLBACKEND": "agg"}
    return {**kept, **own, "NUMBA_CACHE_DIR": "", "PYTHONUSERBASE": site.getuserbase()}


def _caches() -> dict[str, Path]:
    """Return the compiled kernels of the running sources, and the list of fonts, by their places in a user's cache."""
    from slamgauge import jit  # here: it loads numba

    user = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    version = jit.digest()
    found = {f"slamgauge/{version}": jit.parent() / version}
    found |= {f"matplotlib/{each.name}": each for each in (user / "matplotlib").glob("fontlist-*.json")}
    return {place: each for place, each in found.items() if each.exists()}


def _shown() -> list[Path]:
    """Return the paths behind the wall: existing ones, and those that they link to, without those within others."""
    paths = [*map(Path, SYSTEM), *(each for name in SETTINGS for each in Path("/etc").glob(name))]
    paths += [Path(each) for each in _python() if each]
    named = {os.path.normpath(path) for path in paths if path.is_absolute() and os.access(path, os.R_OK)}
    found: list[str] = []
    for path in sorted({*named, *map(os.path.realpath, named)} - {"/"}):
        if not any(path.startswith(f"{other}/") for other in found):
            found.append(path)
    return [*map(Path, found)]


def _python() -> Iterator[str]:
    """Yield the folders of Python, of its libraries and of the programs that the user can start by name."""
    yield from (sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix, sys.executable)
    program = getattr(sys.modules["__main__"], "__file__", None) or ""
    yield from (each for each in sys.path if each and Path(each) not in (Path.cwd(), Path(program).parent))
    for name in ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline", "slamgauge.compare"):
        yield from getattr(find_spec(name), "submodule_search_locations", None) or ()  # a checkout has several folders
    for name in ("PATH", "LD_LIBRARY_PATH"):
        yield from os.environ.get(name, "").split(os.pathsep)
