"""Write folders of results completely or not at all.

slamgauge marks every folder that it makes with a file `.slamgauge.json`. It refuses to write into any other folder that
is not empty. Results are written into a temporary folder first. A new folder of results appears in one rename. In an
existing one, files are replaced one by one, and the file that marks a complete folder comes last.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError

MARK = ".slamgauge.json"


def require_ours(*folders: Path) -> None:
    """Raise `UserError` if a folder exists, is not empty and was not made by slamgauge, or is not a folder."""
    for folder in folders:
        with explained(folder, "written"):
            try:
                folder.lstat()
            except FileNotFoundError:
                continue
            found = [path.name for path in folder.iterdir()]
        if found and MARK not in found:
            remedy = "move it away or give another --out"
            raise UserError(f"{folder}: exists already, and slamgauge has not made it (it has no {MARK}); {remedy}")


def begin_folder(folder: Path) -> None:
    """Make a folder whose files are then written in place; raise `UserError` as `require_ours`."""
    require_ours(folder)
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
        _mark(folder)


@contextmanager
def staged_folder(out: str | Path, writes: Iterable[str], last: str, outdated: Sequence[str] = ()) -> Generator[Path]:
    """Yield a temporary folder; publish its files in `out` if the block succeeds, delete them if it fails.

    Args:
        out: Folder of the results.
        writes: Every name, relative to `out`, that the block may write. Old files that it does not write are removed.
        last: Name of the file that marks a complete folder: the old one is removed first, the new one is moved last.
        outdated: Patterns of further files that are removed.

    Raises:
        UserError: `out` is a folder that slamgauge has not made, or cannot be written.
    """
    out = Path(out)
    require_ours(out)
    with _temporary_folder(out if out.is_dir() else out.parent, out) as stage:
        yield stage
        with explained(out, "written"):
            if not out.exists():
                _mark(stage)
                stage.rename(out)
                return
            try:
                _replace(stage, out, writes, last, outdated)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(f"{out} is written in part; the same command makes it whole") from None


@contextmanager
def staged_files(folder: Path, names: Sequence[str]) -> Generator[Path]:
    """Yield a temporary folder; move its files into a folder of the user's if the block succeeds.

    Raises:
        UserError: a file of one of these names exists already, or the folder cannot be written.
    """
    for name in names:
        if os.path.lexists(folder / name):
            raise UserError(f"{folder / name}: exists already; move it away or give another name")
    with _temporary_folder(folder, folder) as stage:
        yield stage
        with explained(folder, "written"):
            for path in sorted(stage.iterdir()):
                path.replace(folder / path.name)


@contextmanager
def _temporary_folder(parent: Path, out: Path) -> Generator[Path]:
    """Yield an empty folder below `parent`, on the file system of `out`; remove it at the end if it is still there."""
    stage = parent / f".slamgauge.{token_hex(4)}.partial"
    with explained(out, "written"):
        parent.mkdir(parents=True, exist_ok=True)
        stage.mkdir()
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _replace(stage: Path, out: Path, writes: Iterable[str], last: str, outdated: Sequence[str]) -> None:
    """Remove old files from `out`, and move the new files there."""
    new = sorted((path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file()), key=last.__eq__)
    _mark(out)
    if last in new:
        (out / last).unlink(missing_ok=True)
    old = [*(out / name for name in writes), *(path for pattern in outdated for path in out.glob(pattern))]
    for path in old:
        if path.is_file() and path.relative_to(out).as_posix() not in new:
            path.unlink()
    for name in new:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).replace(out / name)


def _mark(folder: Path) -> None:
    (folder / MARK).write_text("{}\n", encoding="ascii")
