"""Public names of a package, imported on first use.

A package lists its names once, as imports in the `if TYPE_CHECKING:` block of its `__init__`. Type checkers follow
these imports; at run time `homes_of` reads them.
"""

from _ast import If, ImportFrom, Module, PyCF_ONLY_AST  # built in: a user's file `ast.py` does not replace it
from collections.abc import Callable
from importlib import import_module


def homes_of(source: bytes) -> dict[str, str]:
    """Return the module of each name that the first `if` statement of a source imports."""
    module = compile(source, "__init__.py", "exec", PyCF_ONLY_AST)
    assert isinstance(module, Module)
    block = next(node for node in module.body if isinstance(node, If))
    imports = [node for node in block.body if isinstance(node, ImportFrom)]
    return {alias.name: node.module or "" for node in imports for alias in node.names}


def importer(package: str, homes: dict[str, str], *modules: str) -> Callable[[str], object]:
    """Return the `__getattr__` of a package: names from their homes, and these modules of the package."""

    def getter(name: str) -> object:
        if name in homes:
            return getattr(__import__(homes[name], fromlist=[name]), name)  # also if `name` is a module
        if name in modules:
            return import_module(f"{package}.{name}")
        if name == "__all__":
            return sorted(homes)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return getter
