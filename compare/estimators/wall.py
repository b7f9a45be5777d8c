"""The wall around user code: what a process with user code sees, and how the system keeps it to that.

Its root contains the system's programs, Python with its libraries, slamgauge and the folder of the user's file, all
read-only. `/tmp`, `/dev/shm` and its home are empty, writable and removed with it. It sees no other process and no
network.

`kind_of_wall` chooses how: namespaces by system call, because forking a process takes milliseconds; else `bwrap`, which
starts an interpreter for every run. Some systems permit only `bwrap`.
"""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, NamedTuple

from slamgauge.compare.estimators import namespaces
from slamgauge.errors import UserError

Kind = Literal["namespaces", "bwrap", "none"]

HOME = "/slamgauge"  # home, current and temporary folder behind the wall
WRITABLE = ("/tmp", "/dev/shm", HOME)
ROOM = "size=500m,nr_inodes=20k,mode=1777"  # size of each
SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/opt", "/nix", "/gnu")
SETTINGS = ("alternatives", "fonts", "group", "ld.so.*", "localtime", "nsswitch.conf", "octave*", "passwd")  # in /etc
DEVICES = ("null", "zero", "full", "random", "urandom")
TRUTHS = ("truth.npz", "*/truth.npz", "results")  # in the folder of the user's file: hidden
CACHES = ("numba", "matplotlib", "fontconfig")  # folders of the user's cache folder
NO_WALL = "this system permits neither user namespaces nor bwrap"
NAMES = ("--hostname", "wall", "--uid", str(namespaces.NOBODY), "--gid", str(namespaces.NOBODY))
APART = ("--unshare-all", "--unshare-user", "--disable-userns")  # no namespaces within these
BWRAP = (*APART, "--die-with-parent", "--new-session", "--cap-drop", "ALL", *NAMES)


class View(NamedTuple):
    """Files and folders behind the wall.

    Attributes:
        shown: absolute paths that can be read.
        hidden: absolute paths within these that are empty.
    """

    shown: list[str]
    hidden: list[str]


@cache
def kind_of_wall() -> Kind:
    """Return the best wall that this system permits."""
    if not sys.platform.startswith("linux"):
        return "none"
    if _works([sys.executable, "-I", "-S", namespaces.__file__]):
        return "namespaces"
    return "bwrap" if has_bwrap() else "none"


def has_bwrap() -> bool:
    """Return whether this system has bwrap, and permits it."""
    return _works(["bwrap", *BWRAP, "--ro-bind", "/", "/", "--proc", "/proc", "true"])


def require_wall(*, unconfined: bool) -> None:
    """Refuse user code where this system can build no wall around it, unless it may run without.

    Raises:
        UserError: with the remedy.
    """
    if not unconfined and kind_of_wall() == "none":
        why = "user code could read and change your files"
        raise UserError(f"{NO_WALL}, so {why}; install bubblewrap, or give --unconfined for code that you trust")


def view(folder: str, neighbours: Collection[str], added: Iterable[str], strangers: Iterable[str]) -> View:
    """Return what user code sees.

    Args:
        folder: folder of the user's file; empty for an installed module.
        neighbours: paths of its helpers relative to the folder, which may begin with `../`.
        added: folders that the code adds to `sys.path`.
        strangers: names of modules and packages in the folder that belong to others.
    """
    place = Path(folder) if folder else None
    hidden, helpers = list[Path](), list[str]()
    if place is not None:
        hidden = [path for pattern in TRUTHS for path in place.glob(pattern)]
        of_others = [*strangers, *(f"{name}.py" for name in strangers)]
        used = {path.partition("/")[0] for path in neighbours}
        hidden += [place / name for name in of_others if name not in used and (place / name).exists()]
        helpers = [folder, *(_top(place, path) for path in neighbours if path.startswith("../")), *added]
    found = [str(path) for path in hidden if not path.is_symlink()]  # a link shows no more than is shown without it
    return View(_whole([*SYSTEM, *_settings(), *_python(), *helpers]), found)


def _top(folder: Path, path: str) -> str:
    """Return the file, or the folder of the package, that a path like `../helper.py` or `../package/file.py` names."""
    steps = Path(path).parts
    levels = steps.count("..")
    return os.path.normpath(folder.joinpath(*steps[: levels + 1]))


def _settings() -> Iterator[str]:
    return (str(path) for name in SETTINGS for path in Path("/etc").glob(name))


def _python() -> Iterator[str]:
    """Yield the folders of Python, of its libraries and of the programs that the user can start by name."""
    yield from (sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix, sys.executable)
    yield from sys.path
    if site.ENABLE_USER_SITE:
        yield site.getusersitepackages()
    for name in ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline", "slamgauge.compare"):
        spec = find_spec(name)  # a checkout has them in several folders
        yield from (spec.submodule_search_locations or ()) if spec is not None else ()
    for name in ("PATH", "LD_LIBRARY_PATH"):
        yield from os.environ.get(name, "").split(os.pathsep)
    yield from (str(caches() / name) for name in CACHES)
    yield os.environ.get("NUMBA_CACHE_DIR", "")


def caches() -> Path:
    """Return the cache folder of the user."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()


def _whole(paths: Iterable[str]) -> list[str]:
    """Return existing absolute paths and the paths that they link to, without those within others, in order."""
    named = {os.path.normpath(path) for path in paths if Path(path).is_absolute() and Path(path).exists()}
    found: list[str] = []
    for path in sorted({*named, *map(os.path.realpath, named)} - {"/"}):
        if not any(path.startswith(f"{other}/") for other in found):
            found.append(path)
    return found


def enter(seen: View) -> None:
    """Build the root of a process in new namespaces, enter it, and give up all privileges.

    Raises:
        OSError: the system refuses a step.
    """
    mount, old, new = namespaces.mount, Path("/old"), Path("/new")
    mount("none", "/", flags=namespaces.RECURSIVE | namespaces.SLAVE)
    mount("tmpfs", "/tmp", "tmpfs", data="mode=755")
    for folder in (old, new):
        Path(f"/tmp{folder}").mkdir()
    namespaces.enter_root("/tmp", "old")
    mount("tmpfs", new, "tmpfs", namespaces.NO_SUID, "mode=755")
    for path in WRITABLE:
        _under(new, path).mkdir(parents=True)
        mount("tmpfs", _under(new, path), "tmpfs", namespaces.NO_SUID | namespaces.NO_DEVICES, ROOM)
    for path in seen.shown:
        _show(_under(old, path), _under(new, path), is_made=path in WRITABLE)
    for path in seen.hidden:
        _hide(_under(new, path))
    for name in DEVICES:
        (new / "dev" / name).touch()
        mount(old / "dev" / name, new / "dev" / name, flags=namespaces.BIND)
    (new / "proc").mkdir()
    with suppress(OSError):  # a container may forbid it; an empty folder shows still less
        unused = namespaces.NO_SUID | namespaces.NO_DEVICES | namespaces.NO_EXECUTION
        mount("proc", new / "proc", "proc", namespaces.READ_ONLY | unused)
    mount("none", new, flags=namespaces.REMOUNT | namespaces.BIND | namespaces.READ_ONLY | namespaces.NO_SUID)
    namespaces.enter_root("/new", "")
    namespaces.set_host_name("wall")
    namespaces.drop_privileges()
    os.chdir(HOME)


def _under(root: Path, path: str) -> Path:
    return Path(f"{root}{path}")


def _show(old: Path, new: Path, *, is_made: bool) -> None:
    """Show a file, folder or link of the old root, read-only, in the new one."""
    new.parent.mkdir(parents=True, exist_ok=True)
    if old.is_symlink():
        new.symlink_to(old.readlink())
        return
    if old.is_dir():
        new.mkdir(exist_ok=is_made)
    else:
        new.touch()
    namespaces.show(old, new)


def _hide(path: Path) -> None:
    """Cover a file or folder by an empty one."""
    if path.is_dir():
        namespaces.mount("tmpfs", path, "tmpfs", namespaces.READ_ONLY)
    elif path.exists():
        namespaces.mount("/old/dev/null", path, flags=namespaces.BIND)


def bwrap_command(seen: View) -> list[str]:
    """Return the words before a command that starts it behind the same wall by bwrap, with its open files."""
    words = [shutil.which("bwrap") or "bwrap", *BWRAP, "--proc", "/proc", "--dev", "/dev"]
    for path in WRITABLE:
        words += ["--tmpfs", path]
    for path in map(Path, seen.shown):
        words += ["--symlink", str(path.readlink())] if path.is_symlink() else ["--ro-bind", str(path)]
        words.append(str(path))
    for path in seen.hidden:
        words += ["--tmpfs", path] if Path(path).is_dir() else ["--ro-bind", os.devnull, path]
    return [*words, "--remount-ro", "/", "--chdir", HOME, "--"]


def _works(command: list[str]) -> bool:
    with suppress(OSError, subprocess.TimeoutExpired):
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=30.0, check=False)
        return done.returncode == 0
    return False
