"""People's own modules, loaded from their folder under private names.

A folder is loaded as a package of a name that nobody has, `_slamgauge_own_1` for instance, and its `filter.py` as
`_slamgauge_own_1.filter`. Modules in it get an `__import__` of their own, which looks into their folder first: there
`import random` finds the neighbour `random.py`, as it does in a script of that folder, and nowhere else. Nothing is
put on `sys.path`, so that whatever people call their files, no other import meets them; two folders, or one folder
loaded twice, do not meet either. Installed libraries are the same for all.

Their names stand in `sys.modules` while the modules are loaded and run (`present`); afterwards they leave, and are
forgotten with the last that refers to them. What is still imported later finds them all the same.
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
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from importlib.machinery import BuiltinImporter, FrozenImporter, ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from weakref import WeakValueDictionary

from slamgauge.compare.estimators.headless_import import hold_windows

PREFIX = "_slamgauge_own_"
OURS = "slamgauge"  # what people import by this name is always this program

_numbers = itertools.count(1)
_folders: WeakValueDictionary[str, PrivateFolder] = WeakValueDictionary()  # by the name of their package
_coming_and_going = threading.RLock()  # what the garbage collector runs meanwhile may import, too


class PrivateFolder:
    """A folder of people's modules, loaded afresh: nothing of it is shared with an earlier loading.

    Args:
        folder: where their modules lie.
        strangers: modules there that count only where no installed one has their name.
    """

    def __init__(self, folder: Path, strangers: Collection[str] = ()) -> None:
        self.folder = folder.resolve()
        self._strangers = strangers
        self._name = f"{PREFIX}{next(_numbers)}"
        self._owned: dict[str, bool] = {}
        self.exits: dict[str, SystemExit] = {}  # of modules that were asked for, by their private names
        self._asked: set[str] = set()
        self._importlib = ModuleType("importlib")
        importlib.invalidate_caches()  # a file may be younger than the last look into its folder
        package = ModuleType(self._name)
        package.__path__ = [str(self.folder)]
        self._away = {self._name: package}  # its modules, while they are not present
        self._present = 0  # how many need them just now
        _folders[self._name] = self
        if _Finder not in sys.meta_path:
            sys.meta_path.insert(0, _Finder)

    def owns(self, name: str) -> bool:
        """Whether `import name` means a module of the folder, as it would in a script that lies there.

        A folder without Python code counts only where no installed module has that name.
        """
        top = name.partition(".")[0]
        if top not in self._owned:
            self._owned[top] = self._finds(top)
        return self._owned[top]

    def load(self, name: str) -> ModuleType:
        """The module `name` of the folder, run on first use; if it calls `exit()`, as far as it came.

        Raises:
            ImportError: it is not there; and whatever it raises.
        """
        self._asked.add(self.private(name))
        with self.present():
            return importlib.import_module(self.private(name))

    @contextmanager
    def present(self) -> Generator[None]:
        """In here its modules have their names, for imports, for pickles, for whoever reads their source."""
        with _coming_and_going:
            self._present += 1
            sys.modules.update(self._away)
            self._away = {}
        try:
            yield
        finally:
            with _coming_and_going:
                self._present -= 1
                if not self._present:
                    names = [name for name in [*sys.modules] if name.partition(".")[0] == self._name]
                    self._away = {name: sys.modules.pop(name) for name in names}

    def run(self, module: ModuleType, body: Callable[[], None]) -> None:
        """Run the body of a module of the folder; an exit in one that was asked for is kept in `exits`."""
        vars(module)["__builtins__"] = self._builtins()
        try:
            body()
        except SystemExit as left:
            if module.__name__ not in self._asked:
                raise
            self.exits[module.__name__] = left

    def private(self, name: str) -> str:
        """The name under which Python keeps the module."""
        return f"{self._name}.{name}"

    def _builtins(self) -> dict[str, object]:
        """Python's builtins with the folder's own `__import__`."""
        return {**vars(builtins), "__import__": self._import}

    def _finds(self, top: str) -> bool:
        if not top or top == OURS or BuiltinImporter.find_spec(top) or FrozenImporter.find_spec(top):
            return False
        found = PathFinder.find_spec(top, [str(self.folder)])
        if found is None or (found.loader is not None and top not in self._strangers):
            return found is not None
        return top not in sys.modules and importlib.util.find_spec(top) is None

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
                found = builtins.__import__(self.private(name), globals, locals, fromlist or (), 0)
                return found if fromlist else sys.modules[self.private(name.partition(".")[0])]
        with self.present() if level else nullcontext():
            found = builtins.__import__(name, globals, locals, fromlist or (), level)
        hold_windows()
        return self._own_importlib() if found is importlib else found

    def _own_importlib(self) -> ModuleType:
        """A stand-in for `importlib` whose `import_module` looks into the folder first, too."""
        vars(self._importlib).update(vars(importlib))
        vars(self._importlib)["import_module"] = self._import_module
        return self._importlib

    def _import_module(self, name: str, package: str | None = None) -> ModuleType:
        with self.present():
            return importlib.import_module(self.private(name) if self.owns(name) else name, package)


class _Finder:
    """Finds the modules of private folders."""

    @staticmethod
    def find_spec(fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        folder = _folders.get(fullname.partition(".")[0])
        spec = None if folder is None else PathFinder.find_spec(fullname, path, target)
        if folder is not None and spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(folder, spec.loader.name, spec.loader.path)
            spec.cached = None
        return spec


class _Loader(SourceFileLoader):
    """Runs a module of a private folder: with its own builtins, from its source, leaving no bytecode behind."""

    def __init__(self, folder: PrivateFolder, name: str, path: str) -> None:
        super().__init__(name, path)
        self._folder = folder

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)

    def exec_module(self, module: ModuleType) -> None:
        self._folder.run(module, partial(super().exec_module, module))


def present(module: ModuleType) -> AbstractContextManager[None]:
    """In here the modules of the private folder that `module` is from have their names; others have them anyway."""
    folder = _folders.get(module.__name__.partition(".")[0])
    return nullcontext() if folder is None else folder.present()


def public(text: str) -> str:
    """A text, the names of private modules in it replaced by those that people know."""
    return re.sub(rf"{PREFIX}\d+\.?", "", text)
