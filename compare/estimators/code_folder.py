"""The folder of user code: its files, their digest, and a copy on another machine or behind a wall.

Files of the folder count, and those of the folders in it that contain Python files, at any depth: Python files, and
other files of at most `LARGEST_FILE` bytes. Hidden files, links that lead out of the folder and stored truths do not.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from slamgauge.errors import UserError

LARGEST_FILE = 1_000_000  # bytes of a file
MOST_BYTES = 20_000_000  # total of all files; files that would exceed it are left out
TRUTH = "truth.npz"


@dataclass(frozen=True)
class CodeFolder:
    """Files of user code: absolute path, name of the module that its code would import, and (path, content) of each."""

    folder: str
    module: str
    files: tuple[tuple[str, bytes], ...]

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of all files and their names."""
        return _digest(self.files)

    def __hash__(self) -> int:
        return hash((self.folder, self.module, self.digest))

    def place(self, *, as_copy: bool = False) -> Path:
        """Return the folder, or a copy: for a wall, and where files have changed, for example on another machine."""
        with suppress(OSError):
            if not as_copy and all(Path(self.folder, path).read_bytes() == content for path, content in self.files):
                return Path(self.folder)
        return _copied(self)


def read_folder(folder: Path, module: str, only: Path | None = None) -> CodeFolder:
    """Read the folder of a module, or one file or folder in it `only`; refuse a Python file that is too large."""
    folder, found, room = folder.resolve(), dict[str, bytes](), MOST_BYTES
    for path in [only.resolve()] if only is not None and only.is_file() else _listed((only or folder).resolve()):
        with suppress(FileNotFoundError):  # another program deletes it after the folder was listed
            size = path.stat().st_size
            if size > LARGEST_FILE and path.suffix == ".py":
                raise UserError(f"{path.name}: has more than {LARGEST_FILE / 1e6:g} MB; keep data in other files")
            if size <= min(LARGEST_FILE, room) and path.is_relative_to(folder):
                found[path.relative_to(folder).as_posix()] = path.read_bytes()
                room -= size
    return CodeFolder(str(folder), module, tuple(sorted(found.items())))


def _listed(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder, Python files first, then those of the folders in it that contain Python files."""
    entries = sorted(each for each in folder.iterdir() if each.name[0] != "." and each.name != TRUTH)
    files = [each for each in entries if each.is_file() and each.resolve() == each and each.suffix != ".pyc"]
    yield from sorted(files, key=lambda each: each.suffix != ".py")
    for each in entries:
        if each.is_dir() and not each.is_symlink() and any(each.glob("*.py")):
            yield from _listed(each)


def installed_digest(name: str) -> str:
    """Return the SHA-256 of the installed module or package that a name begins with; empty if it is not found."""
    with suppress(ImportError, ValueError, OSError):
        spec = find_spec(name.partition(".")[0])
        if spec is not None and spec.origin is not None and Path(spec.origin).is_file():
            origin = Path(spec.origin)
            files = [origin] if spec.submodule_search_locations is None else sorted(origin.parent.rglob("*.py"))
            return _digest(tuple((str(each), each.read_bytes()) for each in files))
    return ""


def _digest(files: tuple[tuple[str, bytes], ...]) -> str:
    total = hashlib.sha256()
    for path, content in files:
        total.update(f"{path} {len(content)} ".encode() + content)
    return total.hexdigest()


@functools.lru_cache(maxsize=64)
def _copied(code: CodeFolder) -> Path:
    """Write the files into a temporary folder, which is removed when this process ends."""
    private = Path(tempfile.mkdtemp(prefix="slamgauge-own-"))
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    folder = private / "code"
    for path, content in code.files:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    for each in (folder, *folder.rglob("*")):
        each.chmod(0o755)  # behind a wall of root another user reads these, but not the private folder
    return folder
