"""Whether the files of slamgauge are the same before and after submissions ran."""

from __future__ import annotations

import compileall
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from slamgauge.errors import UserError

PACKAGES = ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline", "slamgauge.compare")
CODE, KERNELS = (".py", ".pyc"), (".nbc",)  # new kernels may be compiled meanwhile


class State(NamedTuple):
    """Size [bytes] and time of the last change [ns] of a file."""

    size: int
    changed: int


def installed_files() -> dict[Path, State]:
    """Return the state of all sources, bytecode files and kernels of slamgauge; missing bytecode is written before."""
    specs = [find_spec(name) for name in PACKAGES]
    folders = {Path(place) for spec in specs if spec for place in spec.submodule_search_locations or ()}
    found: dict[Path, State] = {}
    for folder in folders:
        compileall.compile_dir(folder, quiet=2)
        for path in folder.rglob("*"):
            if path.suffix in (*CODE, *KERNELS):
                status = path.stat()
                found[path] = State(status.st_size, status.st_mtime_ns)
    return found


def require_same(before: dict[Path, State]) -> None:
    """Refuse results if files of slamgauge have changed since `installed_files`.

    Raises:
        UserError: with the first of these files.
    """
    after = installed_files()
    changed = [path for path, state in before.items() if after.get(path) != state]
    changed += [path for path in after.keys() - before.keys() if path.suffix in CODE]
    if changed:
        what = "was changed while submissions ran, so their grades may be wrong"
        raise UserError(f"{min(changed)}: {what}; install slamgauge again, and look which submission did it")
