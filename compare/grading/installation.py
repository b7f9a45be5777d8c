"""Whether the code of slamgauge is the same before and after submissions ran."""

from __future__ import annotations

import compileall
import sys
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

from slamgauge.errors import UserError

PACKAGES = ("slamgauge", "slamgauge.ekf", "slamgauge.graph_baseline", "slamgauge.compare")
SOURCE, BYTECODE = ".py", f".{sys.implementation.cache_tag}.pyc"
KERNEL = ".nbc"  # new ones may be compiled meanwhile
HEAD = 16  # bytes of a bytecode file before its code: size and time of the source


def installed_files() -> dict[Path, str]:
    """Return the digests of all sources, bytecode files and kernels of slamgauge that this Python runs.

    Missing bytecode is written before. Times do not count, since they change without a change of the code.
    """
    for folder in _folders():
        compileall.compile_dir(folder, quiet=2)
    return _digests()


def _folders() -> set[Path]:
    specs = [find_spec(name) for name in PACKAGES]
    return {Path(place) for spec in specs if spec for place in spec.submodule_search_locations or ()}


def _digests() -> dict[Path, str]:
    found: dict[Path, str] = {}
    for path in (path for folder in _folders() for path in folder.rglob("*")):
        if path.name.endswith((SOURCE, BYTECODE, KERNEL)):
            content = path.read_bytes()
            found[path] = sha256(content[HEAD:] if path.name.endswith(BYTECODE) else content).hexdigest()
    return found


def require_same(before: dict[Path, str]) -> None:
    """Refuse results if files of slamgauge have changed since `installed_files`.

    Raises:
        UserError: with the first of these files.
    """
    after = _digests()
    changed = [path for path, digest in before.items() if after.get(path) != digest]
    changed += [path for path in after.keys() - before.keys() if not path.name.endswith(KERNEL)]
    if changed:
        what = "was changed while submissions ran, so their grades may be wrong"
        raise UserError(f"{min(changed)}: {what}; install slamgauge again, and look which submission did it")
