"""Which files of a folder are ours: the manifest that every command keeps beside what it writes.

`.slamgauge.json` names what slamgauge has written into its folder. What it does not name belongs to somebody else,
and is never replaced or removed. A name under `files` is ours as long as a plain file bears it, reached without
symbolic links. While files are being replaced or removed, their names stand apart, under `moving`, each with the
digests that its content may have before and after: whatever ends the process, what bears such a name later is ours
only if it is what we have written.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, cast

from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.partial_folder import partial_folder, publishing
from slamgauge.compare.storage.result_files import SIDE_FILES, can_be_named
from slamgauge.errors import UserError

MANIFEST = ".slamgauge.json"
REMEDY = "move it away or give another --out"
DIGEST = re.compile("[0-9a-f]{64}")
EMPTY = hashlib.sha256().hexdigest()


def owned(folder: Path) -> set[str]:
    """Names, relative to `folder`, of the files in it that are ours.

    Raises:
        UserError: the manifest cannot be read, or is not one that we have written.
    """
    path = folder / MANIFEST
    with explained(path, "read"):
        if not is_there(path):
            return set()
        if not _is_plain_file(folder, MANIFEST):
            raise _no_manifest(path)
        files, moving = _parsed(path)
        stores = [name for name in files if name.endswith(".sqlite")]
        files |= {f"{store}{ending}" for store in stores for ending in SIDE_FILES}
        ours = {name for name in files if _is_plain_file(folder, name)}
        return ours | {
            name
            for name, digests in moving.items()
            if _is_plain_file(folder, name) and digest_of(folder / name) in digests
        }


def require_free(folder: Path, names: Iterable[str], remedy: str = REMEDY) -> None:
    """Refuse to write files of these names, relative to `folder`, if one would replace a file that is not ours.

    Raises:
        UserError: the first such file, folder or link; or the manifest is not one that we have written.
    """
    ours = owned(folder)
    for name in names:
        for above in _folders_above(name):
            require_folder(folder, above, remedy)
        with explained(folder / name, "written"):
            taken = is_there(folder / name)
        if taken and name not in ours:
            raise UserError(f"{folder / name}: exists already, and slamgauge has not written it; {remedy}")


def require_folder(folder: Path, name: str, remedy: str = REMEDY) -> Path:
    """The folder `name` in `folder`, there or not; `UserError` if a file or a link bears that name."""
    path = folder / name
    if os.path.lexists(path) and (path.is_symlink() or not path.is_dir()):
        raise UserError(f"{path}: exists already, and slamgauge has not written it; {remedy}")
    return path


def write_manifest(
    folder: Path, files: Iterable[str], within: Path, moving: Mapping[str, Iterable[str]] | None = None
) -> None:
    """Write the manifest, at once: names that are ours, and digests of what is being replaced or removed.

    It is written into the partial folder `within` first.
    """
    content = {"files": sorted(files), "moving": {name: [*digests] for name, digests in sorted((moving or {}).items())}}
    partial = within / f"{MANIFEST}.partial"
    partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    partial.replace(folder / MANIFEST)


def begin_file(folder: Path, name: str) -> None:
    """Make an empty file of ours, to be written in place, if there is none; from then on it is ours by its name.

    Raises:
        UserError: a file that is not ours would be replaced, or nothing can be written there.
    """
    require_free(folder, [name])
    with explained(folder, "written"), partial_folder(folder) as within, publishing(folder):
        ours = owned(folder)
        if name not in ours:
            write_manifest(folder, ours, within, {name: [EMPTY]})
            (folder / name).touch(exist_ok=False)
        write_manifest(folder, ours | {name}, within)


def is_there(path: Path) -> bool:
    """Whether anything bears this name, a dangling link too; `OSError` if the name cannot be."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def digest_of(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _parsed(path: Path) -> tuple[set[str], dict[str, list[str]]]:
    """Names, and digests by name, of a manifest; everything in it is checked, since anybody may have written it."""
    try:
        content: Any = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        raise _no_manifest(path) from None
    if not isinstance(content, dict) or content.keys() != {"files", "moving"}:
        raise _no_manifest(path)
    files, moving = content["files"], content["moving"]
    if not isinstance(files, list) or not isinstance(moving, dict):
        raise _no_manifest(path)
    digests = [*moving.values()]
    if not all(_is_name(name) for name in (*files, *moving)) or not all(_are_digests(each) for each in digests):
        raise _no_manifest(path)
    return set(cast("list[str]", files)), cast("dict[str, list[str]]", moving)


def _is_name(value: object) -> bool:
    """Whether it is the plain relative name of a file in a folder or below it."""
    if not isinstance(value, str) or not can_be_named(value):
        return False
    name = PurePosixPath(value)
    return str(name) == value and not name.is_absolute() and ".." not in name.parts and value not in {".", MANIFEST}


def _are_digests(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(each, str) and re.fullmatch("[0-9a-f]{64}", each) for each in value
    )


def _no_manifest(path: Path) -> UserError:
    return UserError(f"{path}: is no list of files that slamgauge has written; move it away or use another folder")


def _is_plain_file(folder: Path, name: str) -> bool:
    """Whether it is a file, and neither it nor a folder on the way from `folder` is a symbolic link."""
    return (folder / name).is_file() and not any((folder / each).is_symlink() for each in (*_folders_above(name), name))


def _folders_above(name: str) -> list[str]:
    """The folders on the way to a relative name, outermost first: `a`, `a/b` for `a/b/c`."""
    return [str(each) for each in reversed(PurePosixPath(name).parents)][1:]
