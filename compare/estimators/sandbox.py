"""The wall around user code: `bwrap` (Debian's package bubblewrap) shows it its own files and the system's programs.

Its root contains the system's programs, Python with its libraries, slamgauge and a copy of the folder of the user's
file, all read-only. `/tmp`, `/dev/shm` and its home are writable, and empty before every run. It sees no other process
and no network, and ends with slamgauge.
"""

from __future__ import annotations

import os
import site
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
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
NOBODY = "65534"
NAMES = ("--hostname", "wall", "--uid", NOBODY, "--gid", NOBODY)
APART = ("--unshare-all", "--unshare-user", "--disable-userns", "--die-with-parent", "--new-session")
BWRAP = ("bwrap", *APART, "--cap-drop", "ALL", *NAMES)
NO_WALL = "bwrap is missing, or this system does not permit it"
KEPT = ("PATH", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "LANG", "LANGUAGE", "TZ", "SSL_CERT_FILE")
KEPT_BEGINNINGS = ("LC_", "LD_", "NUMBA_", "OPENBLAS_", "MKL_", "OMP_", "KMP_", "VECLIB_")
CACHES = "SLAMGAUGE_CACHES"  # variable with the folders of compiled code, which the processes of user code read


def require_wall() -> None:
    """Refuse user code where this system can build no wall around it.

    Raises:
        UserError: with the remedy.
    """
    if not has_wall():
        why = "user code could read and change your files"
        remedy = "install Debian's package bubblewrap, or give --unconfined where a container is the wall"
        raise UserError(f"{NO_WALL}, so {why}; {remedy}")
    for place in (sys.prefix, __file__):
        if _is_emptied(place):
            raise UserError(f"{place}: is in a folder that is empty behind the wall; install slamgauge elsewhere")


def _is_emptied(place: str) -> bool:
    return any(Path(place).is_relative_to(folder) for folder in WRITABLE)


@cache
def has_wall() -> bool:
    """Return whether this system has bwrap, and permits it."""
    with suppress(OSError, subprocess.TimeoutExpired):
        command = [*BWRAP, "--ro-bind", "/", "/", "--proc", "/proc", "true"]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=30.0, check=False)
        return done.returncode == 0
    return False


def walled(command: list[str], code: Path | None) -> list[str]:
    """Return a command that runs behind the wall, with a folder of code at `CODE`."""
    words = [*BWRAP, "--proc", "/proc", "--dev", "/dev"]
    for path in WRITABLE:
        words += ["--size", str(ROOM), "--tmpfs", path]
    for path in _shown():
        link = path.is_symlink()
        words += ["--symlink", str(path.readlink()), str(path)] if link else ["--ro-bind", str(path), str(path)]
    if code is not None:
        words += ["--ro-bind", str(code), CODE]
    return [*words, "--remount-ro", "/", "--chdir", HOME, "--", *command]


def environment(ours: Mapping[str, str]) -> dict[str, str]:
    """Return the environment behind the wall: the places of libraries, and private folders."""
    kept = {name: value for name, value in ours.items() if name in KEPT or name.startswith(KEPT_BEGINNINGS)}
    own = {"HOME": HOME, "TMPDIR": HOME, "PWD": HOME, "XDG_CACHE_HOME": f"{HOME}/.cache", "MPLBACKEND": "agg"}
    caches = _caches()
    if "NUMBA_CACHE_DIR" in kept:
        kept["NUMBA_CACHE_DIR"] = f"{HOME}/.cache/{Path(kept['NUMBA_CACHE_DIR']).name}"
    return {**kept, **own, "PYTHONUSERBASE": site.getuserbase(), CACHES: os.pathsep.join(map(str, caches))}


def _caches() -> list[Path]:
    """Return the user's folders of compiled kernels and fonts, which no process behind the wall changes."""
    user = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    places = [user / name for name in ("slamgauge", "numba", "matplotlib", "fontconfig")]
    places += [Path(each) for each in [os.environ.get("NUMBA_CACHE_DIR", "")] if each]
    return [each for each in places if each.is_dir() and not _is_emptied(str(each))]


def _shown() -> list[Path]:
    """Return the paths behind the wall: existing ones, and those that they link to, without those within others."""
    paths = [*map(Path, SYSTEM), *(each for name in SETTINGS for each in Path("/etc").glob(name)), *_caches()]
    paths += [Path(each) for each in _python() if each]
    named = {os.path.normpath(path) for path in paths if path.is_absolute() and path.exists()}
    found: list[str] = []
    for path in sorted({*named, *map(os.path.realpath, named)} - {"/"}):
        if not any(path.startswith(f"{other}/") for other in found):
            found.append(path)
    return [*map(Path, found)]


def _python() -> Iterator[str]:
    """Yield the folders of Python, of its libraries and of the programs that the user can start by name."""
    yield from (sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix, sys.executable)
    yield from (each for each in sys.path if each and Path(each) != Path.cwd())
    if site.ENABLE_USER_SITE:
        yield site.getusersitepackages()
    for name in ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline", "slamgauge.compare"):
        spec = find_spec(name)  # a checkout has them in several folders
        places: Iterable[str] = (spec.submodule_search_locations or ()) if spec is not None else ()
        yield from places
    for name in ("PATH", "LD_LIBRARY_PATH"):
        yield from (each for each in os.environ.get(name, "").split(os.pathsep) if not _is_emptied(each))
