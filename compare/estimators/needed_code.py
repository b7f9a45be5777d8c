"""User code without its simulation: scripts often simulate and draw after they have defined their filter.

Of a module stay imports, functions and classes, constants, and all statements that bind or change a global which these
functions and classes read. Nothing else at the level of the module is run: calls such as `main()`, loops that
simulate, drawings, prints.
"""

from __future__ import annotations

import ast
import builtins
import symtable
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from types import CodeType
from typing import NamedTuple

from slamgauge.compare.estimators.stand_ins import old_numpy_names

IMPORTS = (ast.Import, ast.ImportFrom)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
DEFINITIONS = (*IMPORTS, *FUNCTIONS, ast.ClassDef)
ASSIGNMENTS = (ast.Assign, ast.AnnAssign)
DRIVERS = {"main"}  # functions that simulate; what only they read is not needed
IN_PLACE = ("np", "numpy", "random")  # modules whose functions may change their arguments: np.fill_diagonal(Q, 1.0)
SETTINGS = ("sys.path.", "np.random.seed", "numpy.random.seed", "random.seed", "np.set_printoptions")  # kept calls


class NeededCode(NamedTuple):
    """A compiled module without its simulation.

    Attributes:
        code: what is left.
        old_numpy: names of older numpy that it uses.
        remark: sentence on the statements left out, or an empty text.
        unbound: names that only these statements bind.
    """

    code: CodeType
    old_numpy: tuple[str, ...]
    remark: str
    unbound: frozenset[str]


def compiled(source: bytes, path: str, wanted: Collection[str]) -> NeededCode:
    """Compile a module as `without_simulation` returns it.

    The result is kept: a launcher compiles the files once, and the processes that it forks have the result.

    Raises:
        SyntaxError: the source is not Python.
    """
    plain = _compiled(source, path, frozenset())
    return _compiled(source, path, frozenset(wanted)) if plain.unbound & {*wanted} else plain


@lru_cache(maxsize=64)
def _compiled(source: bytes, path: str, wanted: frozenset[str]) -> NeededCode:
    tree, left_out = without_simulation(source, path, wanted)
    functions = {node.name: node for node in tree.body if isinstance(node, FUNCTIONS)}
    unbound = frozenset(name for node in left_out for name in _bound(node, functions))
    return NeededCode(compile(tree, path, "exec"), tuple(old_numpy_names(tree)), lines_of(left_out), unbound)


def without_simulation(source: bytes, path: str, wanted: Collection[str]) -> tuple[ast.Module, list[ast.stmt]]:
    """Parse a module; return it without the code that only simulates and draws, and the statements left out.

    Names that are `wanted` of it stay, too.

    Raises:
        SyntaxError: the source is not Python.
    """
    tree = ast.parse(source, path)
    kept = _kept(tree.body, _read_by_definitions(source, path, tree.body) | {*wanted})
    left_out = [node for node in tree.body if node not in kept]
    tree.body = [node for node in tree.body if node in kept]
    return tree, left_out


def _kept(body: list[ast.stmt], needed: set[str]) -> set[ast.stmt]:
    """Return the statements that stay: from the end, those that needed names depend on, then constants."""
    functions = {node.name: node for node in body if isinstance(node, FUNCTIONS)}
    needed = needed - {name for node in body if _is_import(node) for name in _bound(node, functions)}
    kept: set[ast.stmt] = set()
    for node in reversed(body):
        is_fixed = isinstance(node, DEFINITIONS) or _is_text(node) or _is_setting(node) or _has_import(node)
        if is_fixed or (not _is_guard(node) and {*_bound(node, functions)} & needed):
            kept.add(node)
            needed |= {*_read(node)}
    known = {*dir(builtins), "__file__", "__name__", "__doc__"}
    for node in body:
        is_constant = isinstance(node, ASSIGNMENTS) and {*_read(node)} <= known and not {*_called(node)} & {*functions}
        if is_constant:  # other modules may import it
            kept.add(node)
        if node in kept:
            known |= {*_bound(node, functions)}
    return kept


def _read_by_definitions(source: bytes, path: str, body: list[ast.stmt]) -> set[str]:
    """Return the globals that functions and classes read or change, and the names in their headers."""
    found: set[str] = set()
    for table in symtable.symtable(source.decode("utf-8", errors="replace"), path, "exec").get_children():
        if table.get_name() not in DRIVERS:
            found |= {*_globals_of(table)}
    for node in body:
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            outside = [*node.decorator_list, *(node.bases if isinstance(node, ast.ClassDef) else node.args.defaults)]
            found |= {name for each in outside for name in _read(each)}
    return found


def _globals_of(table: symtable.SymbolTable) -> Iterator[str]:
    for symbol in table.get_symbols():
        if symbol.is_global():
            yield symbol.get_name()
    for child in table.get_children():
        yield from _globals_of(child)


def _read(node: ast.AST) -> Iterator[str]:
    """Yield the names that a statement reads at the level of the module."""
    if isinstance(node, DEFINITIONS):
        return
    inside = {each.arg for each in ast.walk(node) if isinstance(each, ast.arg)}  # of lambdas, then of comprehensions
    for each in ast.walk(node):
        if isinstance(each, ast.comprehension):
            inside |= {name.id for name in ast.walk(each.target) if isinstance(name, ast.Name)}
    for each in ast.walk(node):
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load) and each.id not in inside:
            yield each.id


def _called(node: ast.AST) -> Iterator[str]:
    """Yield the names that are called while a statement runs."""
    for each in ast.iter_child_nodes(node):
        if isinstance(each, ast.Lambda):
            continue
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Name):
            yield each.func.id
        yield from _called(each)


def _bound(node: ast.stmt, functions: Mapping[str, ast.AST]) -> Iterator[str]:
    """Yield the names that a statement binds, or whose elements or attributes it sets or whose methods it calls.

    A call of one of `functions` binds the globals that this declares.
    """
    if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
        yield node.name
        return
    for each in ast.walk(node):
        if isinstance(each, ast.Name) and not isinstance(each.ctx, ast.Load):
            yield each.id
        elif isinstance(each, ast.alias):
            yield each.asname or each.name.partition(".")[0]
        elif isinstance(each, ast.Attribute | ast.Subscript) and not isinstance(each.ctx, ast.Load):
            yield from _owner(each)
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and isinstance(node.value.func, ast.Attribute):
        owner = [*_owner(node.value.func)]
        yield from owner
        if owner and owner[0] in IN_PLACE:
            yield from (name for each in node.value.args for name in _owner(each))
    for name in {*_called(node)} & {*functions} - DRIVERS:
        yield from (name for each in ast.walk(functions[name]) if isinstance(each, ast.Global) for name in each.names)


def _owner(node: ast.expr) -> Iterator[str]:
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    if isinstance(node, ast.Name):
        yield node.id


def _is_import(node: ast.stmt) -> bool:
    return isinstance(node, IMPORTS) or _has_import(node)


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_setting(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and ast.unparse(node).startswith(SETTINGS)


def _has_import(node: ast.stmt) -> bool:
    is_block = isinstance(node, ast.Try | ast.If)
    return is_block and any(isinstance(each, ast.Import | ast.ImportFrom) for each in ast.walk(node))


def _is_guard(node: ast.stmt) -> bool:
    """Return whether a statement is `if __name__ == "__main__":`, whose body no import runs."""
    return isinstance(node, ast.If) and "__name__" in _read(node.test)


def lines_of(left_out: Sequence[ast.stmt]) -> str:
    """Return a sentence on the statements left out; an empty text if they would have done nothing of importance."""
    busy = [node for node in left_out if not (_is_guard(node) or isinstance(node, ASSIGNMENTS))]
    if not busy:
        return ""
    first, last = busy[0].lineno, busy[-1].end_lineno
    place = f"line {first} is" if first == last else f"code between lines {first} and {last} is"
    return f"{place} not run: it only simulates, draws or prints"
