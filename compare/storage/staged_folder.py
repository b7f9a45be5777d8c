"""Folders of results that appear whole or not at all, next to whatever else lies there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from secrets import token_hex

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.manifest import REMEDY, digest_of, owned, require_free, write_manifest


@contextmanager
def staged_folder(
    out: str | Path, writes: Iterable[str], last: str, outdated: Sequence[str] = (), remedy: str = REMEDY
) -> Generator[Path]:
    """A temporary folder whose files are published in `out` when the block ends, and dropped when it fails.

    Only files that the manifest in `out` calls ours are replaced or removed; other files of these names are refused and
    left as they are. A new `out` appears in one atomic rename. In an existing one files are replaced one by one: if the
    block wrote the file `last`, the old one is removed before and the new one put in place after all others, so that a
    folder which holds it is whole.

    Args:
        out: the folder.
        writes: every name, relative to `out`, that the block may write; old files of ours go where it does not.
        last: the name that tells of a whole folder.
        outdated: patterns of more names whose old files go if they are ours.
        remedy: what to do about files in the way.

    Raises:
        UserError: On entry if something is in the way or nothing can be written there, at the end if something has got
            in the way since or publishing fails.
    """
    out, writes = Path(out), frozenset(writes)
    require_free(out, sorted(writes), remedy)
    # inside an existing folder: its parent may be another file system, or not ours to write to
    stage = (out if os.path.lexists(out) else out.parent) / f".slamgauge.{token_hex(4)}.partial"
    try:
        with explained(out, "written"):
            stage.mkdir(parents=True)
        yield stage
        with explained(out, "written"):
            new = {path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file()}
            if not os.path.lexists(out):
                write_manifest(stage, new)
                stage.rename(out)
                return
            require_free(out, sorted(new), remedy)
            ours = owned(out)
            stale = {name for name in ours - new if name in writes or any(fnmatchcase(name, each) for each in outdated)}
            try:
                _replace(stage, out, ours, new, stale, last)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(f"{out} is written in part; the same command makes it whole") from None
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _replace(stage: Path, out: Path, ours: set[str], new: set[str], stale: set[str], last: str) -> None:
    """Move the new files to their places, and remove the stale ones."""
    moving = {
        name: [digest_of(at / name) for at in (out, stage) if (at / name).exists()] for name in sorted(new | stale)
    }
    write_manifest(out, ours - moving.keys(), moving)
    if last in new:
        (out / last).unlink(missing_ok=True)
    for name in stale:
        (out / name).unlink()
    for name in sorted(new, key=lambda name: (name == last, name)):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (stage / name).replace(out / name)
    write_manifest(out, (ours | new) - stale)
    for folder in {(out / name).parent for name in stale} - {out}:
        with suppress(OSError):  # somebody else's files are in it
            folder.rmdir()
