"""The manifest `.slamgauge.json`: the list of files in a folder that slamgauge wrote and may replace.

slamgauge never replaces or removes a file that the manifest does not list. A name under `files` counts as written by
slamgauge if it is a plain file and no folder on its path is a symbolic link. While files are replaced or removed, their
names are listed under `moving`, with the SHA-256 digests of the old and the new content. If the process is killed then,
a file of such a name counts as written by slamgauge only if its digest is listed.
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
from slamgauge.compare.storage.result_files import SIDE_FILES, can_be_named
from slamgauge.errors import UserError

MANIFEST = ".slamgauge.json"
REMEDY = "move it away or give another --out"


def owned(folder: Path) -> set[str]:
    """Return the names, relative to `folder`, of the files that slamgauge wrote into it.

    Raises:
        UserError: If the manifest cannot be read or is not valid.
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
    """Raise `UserError` if one of these names, relative to `folder`, is taken by a file that slamgauge did not write.

    Raises:
        UserError: For the first such file, folder or link, or if the manifest is not valid.
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
    """Return the path of the folder `name` in `folder`; raise `UserError` if it is a file or a link."""
    path = folder / name
    if os.path.lexists(path) and (path.is_symlink() or not path.is_dir()):
        raise UserError(f"{path}: exists already, and slamgauge has not written it; {remedy}")
    return path


def write_manifest(
    folder: Path, files: Iterable[str], within: Path, moving: Mapping[str, Iterable[str]] | None = None
) -> None:
    """Write the manifest in one atomic step, by way of the partial folder `within`.

    Args:
        folder: Folder that the manifest describes.
        files: Names of the files that slamgauge wrote.
        within: Partial folder on the same file system.
        moving: Digests, old and new, of the files that are being replaced or removed, by name.
    """
    content = {"files": sorted(files), "moving": {name: [*digests] for name, digests in sorted((moving or {}).items())}}
    partial = within / f"{MANIFEST}.partial"
    partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    partial.replace(folder / MANIFEST)


def is_there(path: Path) -> bool:
    """Return whether the path exists, also as a dangling link; raise `OSError` if the name is not possible."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def digest_of(path: Path) -> str:
    """Return the SHA-256 digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _parsed(path: Path) -> tuple[set[str], dict[str, list[str]]]:
    """Return the names and the digests by name; check everything, because anyone can edit a manifest."""
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
    """Return whether the value is a normalised relative path that stays below its folder."""
    if not isinstance(value, str) or not can_be_named(value):
        return False
    name = PurePosixPath(value)
    return str(name) == value and not name.is_absolute() and ".." not in name.parts and value not in {".", MANIFEST}


def _are_digests(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(each, str) and re.fullmatch("[0-9a-f]{64}", each) for each in value
    )


def _no_manifest(path: Path) -> UserError:
    return UserError(f"{path}: not a list of files that slamgauge has written; move it away or use another folder")


def _is_plain_file(folder: Path, name: str) -> bool:
    """Return whether the name is a file, and no part of its path below `folder` is a symbolic link."""
    return (folder / name).is_file() and not any((folder / each).is_symlink() for each in (*_folders_above(name), name))


def _folders_above(name: str) -> list[str]:
    """Return the folders above a relative name, outermost first: `a`, `a/b` for `a/b/c`."""
    return [str(each) for each in reversed(PurePosixPath(name).parents)][1:]
