"""Folders of results that appear whole or not at all, next to whatever else lies there."""

from __future__ import annotations

import errno
from collections.abc import Generator, Iterable, Sequence
from contextlib import ExitStack, contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path

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
from slamgauge.compare.storage.partial_folder import partial_folder, publishing
from slamgauge.errors import UserError


@contextmanager
def staged_folder(
    out: str | Path,
    writes: Iterable[str],
    last: str,
    outdated: Sequence[str] = (),
    remedy: str = REMEDY,
    beside: str = "",
) -> Generator[Path]:
    """A temporary folder whose files are published in `out` when the block ends, and dropped when it fails.

    Only files that the manifest in `out` calls ours are replaced or removed; other files of these names are refused and
    left as they are. A new `out` appears in one atomic rename. In an existing one files are replaced one by one, by one
    command at a time: if the block wrote the file `last`, the old one is removed before and the new one put in place
    after all others, so that a folder which holds it is whole.

    Args:
        out: the folder.
        writes: every name, relative to `out`, that the block may write; old files of ours go where it does not.
        last: the name that tells of a whole folder.
        outdated: patterns of more names whose old files go if they are ours.
        remedy: what to do about files in the way.
        beside: a file in `out` that the block belongs to; nothing is published if that is replaced meanwhile.

    Raises:
        UserError: On entry if something is in the way or nothing can be written there, at the end if something has got
            in the way since or publishing fails.
    """
    out, writes = Path(out), frozenset(writes)
    require_free(out, sorted(writes), remedy)
    with ExitStack() as stack:
        with explained(out, "written"):
            # inside an existing folder: its parent may be another file system, or not ours to write to
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
    """Make a new folder of the stage, unless `out` is there already."""
    if is_there(out):
        return False
    write_manifest(stage, new, within=stage.parent)
    try:
        stage.rename(out)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        (stage / MANIFEST).unlink()  # another command was first
        return False
    return True


def _replace(stage: Path, out: Path, ours: set[str], new: set[str], stale: set[str], last: str) -> None:
    """Move the new files to their places, and remove the stale ones."""
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
        with suppress(OSError):  # somebody else's files are in it
            folder.rmdir()
