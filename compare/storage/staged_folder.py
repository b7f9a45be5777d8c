"""Write folders of results completely or not at all.

Results are written into a temporary folder first. A new folder of results appears in one rename; in an existing one,
files are replaced one by one, and the main file, which marks complete results, comes last.

A file `.slamgauge.json` marks every folder that slamgauge makes, and lists the files that it has written there, by the
main file of their command. slamgauge writes into no other folder that is not empty.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from slamgauge.compare.storage.files import explained, read_json
from slamgauge.errors import UserError, failure_text

MARK = ".slamgauge.json"
Drawing = Callable[[Path], object]  # writes its files into the given folder


def require_ours(*folders: Path) -> None:
    """Refuse a folder that exists, is not empty and was not made by slamgauge, and what is not a folder."""
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
    """Make a folder whose files are then written in place; refuse it as `require_ours` does."""
    require_ours(folder)
    with explained(folder, "written"):
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / MARK).exists():
            (folder / MARK).write_text("{}\n", encoding="ascii")


@contextmanager
def staged_folder(out: str | Path, main: str, *, adds: bool = False) -> Generator[Path]:
    """Yield a temporary folder; publish its files in `out` if the block succeeds, delete them if it fails.

    Files of an earlier command with the same `main` file are removed: its old main file first, and the new one is moved
    last. With `adds` the files, for example pictures, are added to the results that `main` marks.
    """
    out = Path(out)
    require_ours(out)
    with _temporary_folder(out if out.is_dir() else out.parent, out) as stage:
        yield stage
        with explained(out, "written"):
            written = read_json(out / MARK) if (out / MARK).exists() else {}  # files by main file
            new = sorted(path.relative_to(stage).as_posix() for path in stage.rglob("*") if path.is_file())
            old = {*written.get(main, ())} - {*new}
            written[main] = sorted({*new, *old}) if adds else new
            (stage / MARK).write_text(json.dumps(written), encoding="ascii")
            if not out.exists():
                stage.rename(out)
                return
            for name in () if adds else (main, *old):
                if (out / name).resolve().is_relative_to(out.resolve()):  # somebody may have sent the folder
                    (out / name).unlink(missing_ok=True)
            for name in (MARK, *sorted(new, key=main.__eq__)):
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                (stage / name).replace(out / name)


@contextmanager
def staged_files(folder: Path, names: Sequence[str]) -> Generator[Path]:
    """Yield a temporary folder; move its files into a user's folder if the block succeeds; refuse `names` there."""
    for name in names:
        if os.path.lexists(folder / name):
            raise UserError(f"{folder / name}: exists already; move it away or give another name")
    with _temporary_folder(folder, folder) as stage:
        yield stage
        with explained(folder, "written"):
            for path in stage.iterdir():
                path.replace(folder / path.name)


@contextmanager
def _temporary_folder(parent: Path, out: Path) -> Generator[Path]:
    """Yield an empty folder below `parent`, on the file system of `out`; remove it at the end if it is still there."""
    stage = parent / f".slamgauge.{token_hex(4)}.partial"
    is_new = not parent.exists()
    with explained(out, "written"):
        parent.mkdir(parents=True, exist_ok=True)
        stage.mkdir()
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if is_new:
            with suppress(OSError):  # it contains the results
                parent.rmdir()


def decorate(out: Path, drawings: Mapping[str, Drawing], main: str) -> bool:
    """Draw pictures or pages, by name, of the results that `main` marks in `out`; return whether all were drawn.

    A failure is a line on standard error; the results and the other drawings are kept.
    """
    lost = 0
    for name, draw in drawings.items():
        try:
            with staged_folder(out, main, adds=True) as stage:
                draw(stage)
        except Exception as error:  # noqa: BLE001 even a defect costs one drawing only
            lost += 1
            line = f"{out / name}: not written ({failure_text(error)}); all other files are written"
            print(f"slamgauge: {line}", file=sys.stderr)
    return not lost
