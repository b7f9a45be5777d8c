"""Files of user code: what a module imports, starts or reads from its folder, their digest, and a copy elsewhere."""

from __future__ import annotations

import ast
import atexit
import functools
import hashlib
import itertools
import os
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path

from slamgauge.compare.estimators.pair_files import partner_file
from slamgauge.compare.estimators.syntax_tree import parsed, read_source

MOST_FILES = 1000  # no more imports are followed
LARGEST = 10_000_000  # bytes of a data file that belongs to the sources
LONGEST = 200  # characters of a text that may name a file
LIBRARIES = (*{sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")},)  # folders
LEVELS = 4  # folders above a file in which helpers of its package may lie


@dataclass(frozen=True)
class Sources:
    """A module of user code, what it imports from its folder, and programs and data files of the folder that it names.

    Attributes:
        folder: absolute path.
        module: dotted name, as code of the folder would import it.
        files: (path relative to the folder, content) of each file.
        libraries: SHA-256 of modules that it imports from `PYTHONPATH` and from folders that it adds to `sys.path`.
        top: absolute path of the folder that contains all files, also those that links lead to; empty without a limit.
    """

    folder: str
    module: str
    files: tuple[tuple[str, bytes], ...]
    libraries: str = ""
    top: str = ""

    @property
    def digest(self) -> str:
        """SHA-256 of all files and their names, and of the libraries."""
        return _digest(self.files, self.libraries)

    def place(self) -> Path:
        """Return the folder if its files are unchanged; otherwise, for example on another machine, a copy."""
        try:
            same = all(Path(self.folder, path).read_bytes() == content for path, content in self.files)
        except OSError:
            same = False
        return Path(self.folder) if same else _copied(self)


def sources_of(folder: Path, module: str, strangers: Collection[str] = (), top: Path | None = None) -> Sources:
    """Read a module of a folder and follow its imports, wherever in the code they are written.

    The neighbour with the second function of the Octave course belongs to it, too, and `named_files`.

    Args:
        folder: the folder.
        module: name of the module.
        strangers: modules of the folder that count only if no installed module has their name.
        top: folder of a submission. Files outside do not belong to its sources, although it imports or links to them.

    Raises:
        UserError: a file is too large.
        OSError: a file cannot be read.
    """
    folder, limit = folder.resolve(), "" if top is None else str(top.resolve())
    files = _followed(folder, module, strangers, limit)
    return Sources(str(folder), module, files, _libraries(folder, files, limit), limit)


def _followed(
    folder: Path, module: str, strangers: Collection[str] = (), top: str = ""
) -> tuple[tuple[str, bytes], ...]:
    """Return the files of `sources_of`."""
    found: dict[str, bytes] = {}
    waiting = list(_files_of(folder, module, top=top))
    partner = partner_file(folder / waiting[0]) if len(waiting) == 1 else None
    waiting += [] if partner is None else [partner.name]
    while waiting and len(found) < MOST_FILES:
        path = waiting.pop()
        if path not in found:
            is_code = path.endswith(".py")
            found[path] = read_source(folder / path) if is_code else (folder / path).read_bytes()
            names = {*imported_names(found[path])}
            waiting += [file for name in names for file in _files_of(folder, name, strangers, top)]
            places = dict.fromkeys((folder, (folder / path).parent)) if is_code else ()
            named = [each for place in places for each in named_files(place, found[path], top)]
            relative = [Path(os.path.relpath(each, folder)).as_posix() for each in named]
            waiting += [each for each in relative if each.partition("/")[0].removesuffix(".py") not in strangers]
    return tuple(sorted(found.items()))


def _libraries(folder: Path, files: tuple[tuple[str, bytes], ...], top: str) -> str:
    """Return the SHA-256 of modules that files import from `PYTHONPATH` and `added_folders`; empty without any."""
    contents = [content for path, content in files if path.endswith(".py")]
    places = [Path(each) for each in os.environ.get("PYTHONPATH", "").split(os.pathsep) if each]
    places += [Path(each) for content in contents for each in added_folders(folder, content, top)]
    names = sorted({name for content in contents for name in imported_names(content)})
    found: dict[str, bytes] = {}
    for place, name in itertools.product(dict.fromkeys(places), names):
        if place.resolve() != folder and any((place / top).exists() for top in _heads(name)):
            found |= {f"{place}/{path}": content for path, content in _followed(place.resolve(), name)}
    return _digest(tuple(sorted(found.items()))) if found else ""


def installed_digest(name: str) -> str:
    """Return the SHA-256 of an installed module or of the package that contains it; empty if it is not found.

    Outside the folders of libraries, modules of the same folder that it imports count, too.
    """
    with suppress(ImportError, ValueError):
        spec = find_spec(name.partition(".")[0])
        if spec is not None and spec.origin is not None and Path(spec.origin).is_file():
            folder = Path(spec.origin).parents[0 if spec.submodule_search_locations is None else 1]
            if str(folder) not in LIBRARIES:
                return _digest(_followed(folder, name))
            return _digest(tuple((path, (folder / path).read_bytes()) for path in _files_of(folder, name)))
    return ""


def _heads(name: str) -> tuple[str, str]:
    """Return the files of which one exists where a module can be imported."""
    top = name.partition(".")[0]
    return f"{top}.py", f"{top}/__init__.py"


def _digest(files: tuple[tuple[str, bytes], ...], more: str = "") -> str:
    total = hashlib.sha256()
    for path, content in files:
        total.update(f"{path} {len(content)} ".encode() + content)
    total.update(more.encode())
    return total.hexdigest()


def named_files(folder: Path, content: bytes, top: str = "") -> list[Path]:
    """Return the files whose names are texts in a source, and all `.m` if it starts a program.

    They are in a folder, or in folders in it that are texts, too.

    Such files are data that the code reads, and programs that it starts with `adapters.external`. Data files of more
    than `LARGEST` bytes, and files that it opens for writing, do not belong to the sources.
    """
    nodes = [*ast.walk(parsed(content))]
    opened = [node for node in nodes if isinstance(node, ast.Call) and ast.unparse(node.func) == "open" and node.args]
    modes = [[*call.args[1:2], *(each.value for each in call.keywords if each.arg == "mode")] for call in opened]
    letters = [{letter for each in mode for text in _texts(each) for letter in text} for mode in modes]
    writing = [call for call, used in zip(opened, letters, strict=True) if used & set("wax+")]
    written = {Path(text).name for call in writing for text in _texts(call.args[0])}
    words = {text for node in nodes if isinstance(node, ast.Constant) for text in _texts(node) if len(text) < LONGEST}
    named = {Path(text).name for text in words} - written
    paths = {folder / text for text in words}
    inside = {each for path in paths for each in (path, path.parent) if folder in each.parents and each.is_dir()}
    octave = b"external(" in content
    files = [each for place in (folder, *inside) for each in place.iterdir() if each.name in named]
    files += folder.glob("*.m") if octave else ()
    return [each for each in files if _is_file_in(top, each) and each.stat().st_size <= LARGEST]


def is_in(top: str, path: Path) -> bool:
    """Return whether a file or folder, or what a link leads to, lies in a folder; true without a folder."""
    return not top or path.resolve().is_relative_to(top)


def _is_file_in(top: str, path: Path) -> bool:
    """Return whether a path is a file, neither pipe nor device, that `is_in` a folder."""
    return path.is_file() and is_in(top, path)


def _texts(node: ast.AST) -> list[str]:
    """Return the texts in a node, in their order."""
    return [each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str)]


def imported_names(content: bytes) -> Iterator[str]:
    """Yield the names that a source imports: `module`, or `module.name` for `from module import name`."""
    for node in ast.walk(parsed(content)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = getattr(node, "module", None)
            yield from (f"{module}.{alias.name}" if module else alias.name for alias in node.names)


def _files_of(folder: Path, name: str, strangers: Collection[str] = (), top: str = "") -> Iterator[str]:
    """Yield the file of a module, or all files of the package that contains it, relative to the folder.

    One of `strangers`, or in a folder above, counts if no installed module has its name; its path begins with `../`.
    """
    head = name.partition(".")[0]
    for level, place in enumerate([folder, *folders_above(folder)]):
        module, package = place / f"{head}.py", place / head
        is_module = _is_file_in(top, module)
        if not is_module and not _is_file_in(top, package / "__init__.py"):
            continue
        if (not level and head not in strangers) or not _is_installed(head):
            for file in [module] if is_module else sorted(package.rglob("*.py")):
                if _is_file_in(top, file):
                    yield "../" * level + file.relative_to(place).as_posix()
        return


def added_folders(folder: Path, content: bytes, top: str = "") -> Iterator[str]:
    """Yield folders beside or above a folder that a source adds to `sys.path` by a name, as `"../library"`."""
    if b"sys.path" not in content:
        return
    with suppress(ValueError, RecursionError):  # an impossible path, deep nesting
        calls = [node for node in ast.walk(parsed(content)) if isinstance(node, ast.Call)]
        added = [each for each in calls if ast.unparse(each.func) in ("sys.path.append", "sys.path.insert")]
        words = [node.value for each in added for node in ast.walk(each) if isinstance(node, ast.Constant)]
        for place in (folder, *folders_above(folder)):
            found = [(place / word).resolve() for word in words if isinstance(word, str) and word.strip("./")]
            yield from (str(each) for each in found if each.is_dir() and is_in(top, each))


def folders_above(folder: Path) -> list[Path]:
    """Return the folders above a folder in which helpers of its package may lie, the nearest first."""
    return [*folder.parents][:LEVELS]


def _is_installed(top: str) -> bool:
    return top in sys.builtin_module_names or top in sys.modules or PathFinder.find_spec(top) is not None


@functools.lru_cache(maxsize=64)
def _copied(sources: Sources) -> Path:
    """Write the files into a temporary folder, which is removed when this process ends."""
    root = Path(tempfile.mkdtemp(prefix="slamgauge-own-"))
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    folder = root.joinpath(*["own"] * LEVELS)  # paths of files may begin with ../
    folder.mkdir(parents=True)
    for path, content in sources.files:
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    return folder
