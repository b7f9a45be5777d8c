"""Write folders of results completely or not at all, and leave other files there unchanged.

Unfinished results are in partial folders. Locks keep commands that write to the same place apart; a lock ends with its
process. A partial folder with a free lock was left by a killed command and is removed.
"""

from __future__ import annotations

import errno
import hashlib
import shutil
from collections.abc import Generator, Iterable, Sequence
from contextlib import ExitStack, contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from secrets import token_hex

from filelock import FileLock, Timeout

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.manifest import (
    MANIFEST,
    REMEDY,
    digest_of,
    is_there,
    owned,
    require_free,
    write_manifest,
)
from slamgauge.errors import UserError

MARK = "mark"  # proof that slamgauge made the folder
OWNER = "owner"  # locked while a command works in the folder
FILES = "files"
PUBLISHING = ".slamgauge.lock"
PATIENCE = 10.0  # s; publishing takes a fraction of that
EMPTY = hashlib.sha256().hexdigest()


@contextmanager
def staged_folder(
    out: str | Path,
    writes: Iterable[str],
    last: str,
    outdated: Sequence[str] = (),
    remedy: str = REMEDY,
    beside: str = "",
) -> Generator[Path]:
    """Yield a temporary folder; publish its files in `out` if the block succeeds, delete them if it fails.

    Only files that the manifest in `out` lists are replaced or removed; any other file of such a name is an error.
    A new `out` appears in one atomic rename. In an existing `out` files are replaced one by one, by one command at a
    time. If the block wrote the file `last`, the old one is removed first and the new one is moved last, so a folder
    that contains it is complete.

    Args:
        out: Folder of the results.
        writes: Every name, relative to `out`, that the block may write. Old files that it does not write are removed.
        last: Name of the file that marks a complete folder.
        outdated: Patterns of further names whose old files are removed.
        remedy: End of the error message about a file that slamgauge did not write.
        beside: A file in `out` that the block refers to; nothing is published if it is replaced meanwhile.

    Raises:
        UserError: On entry if a file of another origin has one of the names or `out` cannot be written; at the end for
            the same reasons.
    """
    out, writes = Path(out), frozenset(writes)
    require_free(out, sorted(writes), remedy)
    with ExitStack() as stack:
        with explained(out, "written"):
            # inside an existing folder, because its parent may be on another file system or read-only
            stage = stack.enter_context(partial_folder(out if is_there(out) else out.parent))
            companion = digest_of(out / beside) if beside else ""
        yield stage
        with explained(out, "written"):
            new = {path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file()}
            if _appeared(stage, out, new):
                return
            with publishing(out):
                require_free(out, sorted(new), remedy)
                if beside and digest_of(out / beside) != companion:
                    raise UserError(f"{out / beside}: another command has replaced it meanwhile")
                ours = owned(out)
                outdated_now = {name for name in ours - new if any(fnmatchcase(name, each) for each in outdated)}
                try:
                    _replace(stage, out, ours, new, (ours - new) & writes | outdated_now, last)
                except KeyboardInterrupt:
                    raise KeyboardInterrupt(f"{out} is written in part; the same command makes it whole") from None


def _appeared(stage: Path, out: Path, new: set[str]) -> bool:
    """Rename the stage to `out` and return True, unless `out` exists."""
    if is_there(out):
        return False
    write_manifest(stage, new, within=stage.parent)
    try:
        stage.rename(out)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        (stage / MANIFEST).unlink()  # another command created it first
        return False
    return True


def _replace(stage: Path, out: Path, ours: set[str], new: set[str], stale: set[str], last: str) -> None:
    """Move the new files into `out` and remove the stale ones."""
    moving = {
        name: [digest_of(at / name) for at in (out, stage) if (at / name).exists()] for name in sorted(new | stale)
    }
    write_manifest(out, ours - moving.keys(), stage.parent, moving)
    if last in new:
        (out / last).unlink(missing_ok=True)
    for name in stale:
        (out / name).unlink()
    for name in sorted(new, key=lambda name: (name == last, name)):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).replace(out / name)
    write_manifest(out, (ours | new) - stale, stage.parent)
    for folder in {(out / name).parent for name in stale} - {out}:
        with suppress(OSError):  # the folder contains other files
            folder.rmdir()


def begin_file(folder: Path, name: str) -> None:
    """Create an empty file that is later written in place, unless it exists, and list it in the manifest.

    Raises:
        UserError: If slamgauge did not write the existing file, or the folder cannot be written.
    """
    require_free(folder, [name])
    with explained(folder, "written"), partial_folder(folder) as within, publishing(folder):
        ours = owned(folder)
        if name not in ours:
            write_manifest(folder, ours, within, {name: [EMPTY]})
            (folder / name).touch(exist_ok=False)
        write_manifest(folder, ours | {name}, within)


@contextmanager
def partial_folder(parent: Path) -> Generator[Path]:
    """Yield an empty folder below `parent`, on the same file system; it is removed with its contents at the end.

    Partial folders of killed commands are removed first. `parent` is created if it is missing.
    """
    parent.mkdir(parents=True, exist_ok=True)
    _remove_abandoned(parent)
    folder = parent / f".slamgauge.{token_hex(4)}.partial"
    folder.mkdir()
    try:
        with FileLock(folder / OWNER, timeout=0):
            try:
                (folder / MARK).write_bytes(_mark(folder))
                (folder / FILES).mkdir()
                yield folder / FILES
            finally:
                shutil.rmtree(folder / FILES, ignore_errors=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def publishing(folder: Path) -> Generator[None]:
    """Be the only command that moves files into `folder` or changes its manifest.

    Raises:
        UserError: another command does that and does not finish in time.
    """
    try:
        with lock_file(folder / PUBLISHING, PATIENCE):
            yield
    except Timeout:
        raise UserError(
            f"{folder}: another command has been writing there for {PATIENCE:g} s; wait for it, "
            "and give the same command again"
        ) from None


@contextmanager
def lock_file(path: Path, seconds: float = 0.0) -> Generator[None]:
    """Hold a lock by a file at `path`, which is removed at the end.

    Raises:
        Timeout: another process still holds it after that many seconds.
        OSError: the file cannot be written.
    """
    with FileLock(path, timeout=seconds):
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes no open file; its lock does that
                path.unlink()


def _remove_abandoned(parent: Path) -> None:
    """Remove partial folders that no command works in; folders that are not provably ours stay."""
    for folder in parent.glob(".slamgauge.*.partial"):
        with suppress(OSError, Timeout):  # foreign, in use, or being removed by another command
            mark = folder / MARK
            if folder.is_symlink() or mark.is_symlink() or not mark.is_file() or mark.read_bytes() != _mark(folder):
                continue
            with FileLock(folder / OWNER, timeout=0):
                shutil.rmtree(folder / FILES, ignore_errors=True)
            shutil.rmtree(folder, ignore_errors=True)


def _mark(folder: Path) -> bytes:
    """Return content that no folder of another name or place has: a copy has another inode."""
    return f"{folder.name} {folder.stat().st_ino}\n".encode()
