"""People's code as it stands in its folder: what it consists of, its digest, and the way to a worker."""

from __future__ import annotations

import ast
import atexit
import functools
import hashlib
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

MOST_FILES = 1000  # modules that are followed from file to file


@dataclass(frozen=True)
class Sources:
    """A module of people's code and what it imports from its folder.

    Attributes:
        folder: where they lie, absolute.
        module: dotted, as the folder's own code would import it.
        files: (path relative to the folder, content) of each.
    """

    folder: str
    module: str
    files: tuple[tuple[str, bytes], ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all files and their names."""
        total = hashlib.sha256()
        for path, content in self.files:
            total.update(f"{path} {len(content)} ".encode() + content)
        return total.hexdigest()

    def place(self) -> Path:
        """The folder if the code is still what it was there, or else, on another machine for instance, a copy."""
        try:
            same = sources_of(Path(self.folder), self.module) == self
        except OSError:
            same = False
        return Path(self.folder) if same else _copied(self)


def sources_of(folder: Path, module: str) -> Sources:
    """The sources of a module of a folder, imports followed as they are written, wherever in the code.

    Raises:
        OSError: a file cannot be read.
    """
    folder = folder.resolve()
    found: dict[str, bytes] = {}
    waiting = list(_files_of(folder, module))
    while waiting and len(found) < MOST_FILES:
        path = waiting.pop()
        if path not in found:
            found[path] = (folder / path).read_bytes()
            waiting += _neighbours(folder, found[path])
    return Sources(str(folder), module, tuple(sorted(found.items())))


def _neighbours(folder: Path, content: bytes) -> Iterator[str]:
    """Files of the folder that this module of it imports, relative to the folder; of a package all."""
    try:
        nodes = list(ast.walk(ast.parse(content)))
    except (SyntaxError, ValueError):  # loading it will say so
        return
    for node in nodes:
        names: list[str] = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names]
        for name in names:
            yield from _files_of(folder, name)


def _files_of(folder: Path, name: str) -> Iterator[str]:
    """The file of a module, or all of the package that it is in."""
    top = name.partition(".")[0]
    module, package = folder / f"{top}.py", folder / top
    if module.is_file():
        yield module.name
    elif (package / "__init__.py").is_file():
        for file in sorted(package.rglob("*.py")):
            yield file.relative_to(folder).as_posix()


@functools.lru_cache(maxsize=64)
def _copied(sources: Sources) -> Path:
    """A temporary folder with the files, removed when the process ends."""
    folder = Path(tempfile.mkdtemp(prefix="slamgauge-own-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for path, content in sources.files:
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return folder
