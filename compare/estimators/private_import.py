"""User modules, loaded from their folder under private names.

A folder is loaded as a package with an unused name, for example `_slamgauge_own_1`, and its `filter.py` as
`_slamgauge_own_1.filter`. Its modules get their own `__import__`, which searches their folder first: there
`import random` finds the neighbour `random.py`, as in a script of that folder. `sys.path` is not changed, so that no
other import finds user files, whatever their names. Two folders, or two loadings of one folder, share no module except
installed libraries.

`sys.modules` contains the modules while they are loaded and run (`present`). Imports that run later still find them.

User files often draw: while they are loaded or run, figures are neither shown nor waited for (`no_windows`). A module
that neither the folder nor the installed libraries have is searched in the folders that the code adds to `sys.path`,
then in the folders above (`folders_above`).
"""

from __future__ import annotations

import builtins
import importlib
import importlib.util
import itertools
import re
import sys
import threading
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import partial
from importlib.machinery import BuiltinImporter, FrozenImporter, ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from weakref import WeakValueDictionary

from slamgauge.compare.estimators.needed_code import compiled
from slamgauge.compare.estimators.no_windows import hold_windows, without_windows
from slamgauge.compare.estimators.sources import folders_above
from slamgauge.compare.estimators.stand_ins import stand_in, supplied

PREFIX = "_slamgauge_own_"
OURS = "slamgauge"  # user code that imports this name always gets this program

_numbers = itertools.count(1)
_folders: WeakValueDictionary[str, PrivateFolder] = WeakValueDictionary()  # package name -> folder
_presence = threading.RLock()  # reentrant: code that the garbage collector runs inside may import, too


class PrivateFolder:
    """One loading of a folder of user modules.

    Args:
        folder: the folder.
        strangers: modules of the folder that count only if no installed module has their name.
        wanted: names that stay in a module even if nothing in it reads them (see `needed_code`); None loads modules
            whole.
    """

    def __init__(self, folder: Path, strangers: Collection[str] = (), wanted: Collection[str] | None = None) -> None:
        self.folder = folder.resolve()
        self._strangers = strangers
        self._wanted = wanted
        self._old_numpy: list[str] = []
        self._supplies = ExitStack()  # removes these names from numpy while the modules are away
        self.remarks: dict[str, None] = {}  # what users should know of the loading, in order
        self._name = f"{PREFIX}{next(_numbers)}"
        self._owned: dict[str, bool] = {}
        self.exits: dict[str, SystemExit] = {}  # private names of modules loaded by `load` -> their exits
        self._requested: set[str] = set()
        self._importlib = ModuleType("importlib")
        importlib.invalidate_caches()  # a file may be younger than the cached list of its folder
        package = ModuleType(self._name)
        package.__path__ = self._places = [str(self.folder)]
        self._path_before = [*sys.path]
        self._added: list[str] = []  # what its modules added to `sys.path`, which is restored after loading
        self._away = {self._name: package}  # modules, while they are not in `sys.modules`
        self._present = 0  # number of callers that need them in `sys.modules`
        _folders[self._name] = self
        if _Finder not in sys.meta_path:
            sys.meta_path.insert(0, _Finder)

    def owns(self, name: str) -> bool:
        """Return whether `import name` in a script of the folder would import a module of the folder.

        A subfolder without Python code counts only if no installed module has its name.
        """
        top = name.partition(".")[0]
        if top not in self._owned:
            self._owned[top] = self._finds(top)
        return self._owned[top]

    def load(self, name: str) -> ModuleType:
        """Load the module `name` of the folder; if it calls `exit()`, it contains what it defined before.

        Raises:
            ImportError: the module does not exist.
            Exception: any error of the module.
        """
        private = self._private(name)
        self._requested.add(private)
        before = [*sys.path]
        try:
            with self.present():
                return importlib.import_module(private)
        finally:
            self._added += [place for place in map(str, sys.path) if place not in before]
            sys.path[:] = before

    def offers(self, name: str) -> bool:
        """Return whether the module `name` of the folder belongs to this user code."""
        return self.owns(name) and name not in self._strangers

    @contextmanager
    def present(self) -> Generator[None]:
        """Keep the modules in `sys.modules` inside this context, as imports, pickle and `inspect` need."""
        with _presence:
            self._present += 1
            if self._present == 1:
                self._supplies.enter_context(supplied(self._old_numpy))
            sys.modules.update(self._away)
            self._away = {}
        try:
            yield
        finally:
            with _presence:
                self._present -= 1
                if not self._present:
                    self._supplies.close()
                    names = [name for name in [*sys.modules] if name.partition(".")[0] == self._name]
                    self._away = {name: sys.modules.pop(name) for name in names}

    def run(self, module: ModuleType, body: Callable[[], None]) -> None:
        """Run the body of a module with the folder's `__import__`; if `load` requested it, record its exit."""
        vars(module)["__builtins__"] = {**vars(builtins), "__import__": self._import}
        try:
            body()
        except SystemExit as exited:
            if module.__name__ not in self._requested:
                raise
            self.exits[module.__name__] = exited

    def _private(self, name: str) -> str:
        return f"{self._name}.{name}"

    def _finds(self, top: str) -> bool:
        if not top or top == OURS or BuiltinImporter.find_spec(top) or FrozenImporter.find_spec(top):
            return False
        found = PathFinder.find_spec(top, [str(self.folder)])
        if found is None:
            return self._finds_elsewhere(top)
        if found.loader is not None and top not in self._strangers:
            return True
        return top not in sys.modules and importlib.util.find_spec(top) is None

    def _finds_elsewhere(self, top: str) -> bool:
        """Search folders that the code added to `sys.path`, then the folders above; installed modules come first."""
        if top in sys.modules or PathFinder.find_spec(top, self._path_before) is not None:
            return False
        added = [str(self.folder / place) for place in map(str, sys.path) if place not in self._path_before]
        for place in [*self._added, *added, *map(str, folders_above(self.folder))]:
            found = PathFinder.find_spec(top, [place])
            if found is not None and found.loader is not None:
                self._places.append(place)
                self.remarks[f"{top} is loaded from {place}"] = None
                return True
        return False

    def _import(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        if not level and self.owns(name):
            with self.present():
                found = builtins.__import__(self._private(name), globals, locals, fromlist or (), 0)
                return found if fromlist else sys.modules[self._private(name.partition(".")[0])]
        with self.present() if level else nullcontext():
            try:
                found = builtins.__import__(name, globals, locals, fromlist or (), level)
            except ModuleNotFoundError as error:
                found = self._stand_in(name, error, is_whole=not fromlist)
        hold_windows()
        return self._own_importlib() if found is importlib else found

    def _stand_in(self, name: str, error: ModuleNotFoundError, *, is_whole: bool) -> ModuleType:
        """Return a stand-in for a missing module, the package of it if `is_whole`; raise the error if there is none."""
        stood_in = stand_in(name)
        if stood_in is None or error.name is None or not f"{name}.".startswith(f"{error.name}."):
            raise error
        found, remark = stood_in
        self.remarks[remark] = None
        for part in [] if is_whole else name.split(".")[1:]:
            found = getattr(found, part)
        return found

    def compiled(self, source: bytes, path: str) -> CodeType | None:
        """Return the code of a module without its simulation; None if it is loaded whole."""
        if self._wanted is None:
            return None
        needed = compiled(source, path, self._wanted)
        self._supplies.enter_context(supplied(needed.old_numpy))
        self._old_numpy += needed.old_numpy
        if self._old_numpy:
            used = ", ".join(f"np.{each}" for each in self._old_numpy)
            self.remarks[f"{used}: names of an older numpy are supplied"] = None
        if needed.remark:
            self.remarks[f"{Path(path).name}: {needed.remark}"] = None
        return needed.code

    def _own_importlib(self) -> ModuleType:
        """Return a copy of `importlib` whose `import_module` searches the folder first."""
        vars(self._importlib).update(vars(importlib))
        vars(self._importlib)["import_module"] = self._import_module
        return self._importlib

    def _import_module(self, name: str, package: str | None = None) -> ModuleType:
        with self.present():
            return importlib.import_module(self._private(name) if self.owns(name) else name, package)


class _Finder:
    """Finder of modules of private folders."""

    @staticmethod
    def find_spec(fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        folder = _folders.get(fullname.partition(".")[0])
        spec = None if folder is None else PathFinder.find_spec(fullname, path, target)
        if folder is not None and spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(folder, spec.loader.name, spec.loader.path)
            spec.cached = None
        return spec


class _Loader(SourceFileLoader):
    """Loader of a module of a private folder: always from its source, and without writing bytecode."""

    def __init__(self, folder: PrivateFolder, name: str, path: str) -> None:
        super().__init__(name, path)
        self._folder = folder

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        source = self.get_data(path)
        return self._folder.compiled(source, path) or self.source_to_code(source, path)

    def exec_module(self, module: ModuleType) -> None:
        self._folder.run(module, partial(super().exec_module, module))


def present(module: ModuleType) -> AbstractContextManager[None]:
    """Return `PrivateFolder.present` of the folder of `module`; an empty context for other modules."""
    folder = folder_of(module.__name__)
    return nullcontext() if folder is None else folder.present()


@contextmanager
def in_use(module: ModuleType) -> Generator[None]:
    """Keep a module `present` while it runs, and disable windows."""
    with without_windows(), present(module):
        yield


def folder_of(module: str) -> PrivateFolder | None:
    """Return the folder that a module was loaded from, given its private name; None for other modules."""
    return _folders.get(module.partition(".")[0])


def remarks_on_loading(module: ModuleType) -> list[str]:
    """Return what users should know of the loading of a module: lines left out, stand-ins of libraries."""
    folder = folder_of(module.__name__)
    return [] if folder is None else [*folder.remarks]


def public(text: str) -> str:
    """Replace the names of private modules in a text by the names that users wrote."""
    return re.sub(rf"{PREFIX}\d+\.?", "", text)
