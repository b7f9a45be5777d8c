"""Submissions of a folder."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slamgauge.compare.estimators.adapters import NAMES
from slamgauge.compare.estimators.answers import printable
from slamgauge.compare.estimators.code_folder import read_folder
from slamgauge.compare.estimators.requests import Address
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError

NOTEBOOK = ".ipynb"
NOT_A_NOTEBOOK = "notebooks are not run; hand in its code as a .py file (jupyter nbconvert --to script)"
LONGEST_NAME = 100  # bytes, so that it can name a page
MAIN = ("submission.py", "main.py")  # main file of a folder with several files, the first of them that exists


@dataclass(frozen=True)
class Submission:
    """A submitted filter."""

    name: str  # name of its file or folder
    where: Address | None  # its file or package, without the name of a callable; None if there is a reason
    reason: str = ""  # why it cannot be run


def submissions_in(folder: Path) -> list[Submission]:
    """Return every Python file of a folder, and every folder in it that contains Python files, by name.

    The main file of a folder is `submission.py`; else the folder is a package, or its main file is its only Python
    file, `main.py`, or the only file that defines a known form (`_defines_a_form`). If only folders in it contain
    Python files, the main file is in one of these. Names that begin with a dot or an underscore are skipped. A notebook
    is a submission, which is not graded. No code runs.

    Raises:
        UserError: the folder cannot be read, or contains no submission.
    """
    with explained(folder, "read"):
        entries = sorted(each for each in folder.iterdir() if each.name[0] not in "._")
    given = [
        each
        for each in entries
        if _is_python(each) or each.suffix == NOTEBOOK or any(each.glob("*.py")) or _folders_with_python(each)
    ]
    if not given:
        raise UserError(f"{folder}: contains no submission; give a folder of Python files, or of folders with them")
    stems = [each.stem if _is_python(each) else each.name for each in given]
    names = _distinct(stems, [each.name for each in given])
    return [_submission(path, name) for path, name in zip(given, names, strict=True)]


def _distinct(stems: Sequence[str], files: Sequence[str]) -> list[str]:
    """Return distinct names that can name pages; where necessary they end with the position in the folder."""
    names = [printable(stem if stems.count(stem) == 1 else file) for stem, file in zip(stems, files, strict=True)]
    return [
        name if names.count(name) == 1 and 0 < len(name.encode()) <= LONGEST_NAME else f"{name[:20]} #{place}".strip()
        for place, name in enumerate(names, start=1)
    ]


def _submission(path: Path, name: str) -> Submission:
    """Return the submission at a path: a file alone, or a folder with all that it contains."""
    try:
        return Submission(name, _address(path, name))
    except UserError as error:
        return Submission(name, None, str(error))
    except OSError as error:
        return Submission(name, None, f"{path.name}: cannot be read ({error.strerror}); check its permissions")


def _address(path: Path, name: str) -> Address:
    if path.suffix == NOTEBOOK:
        raise UserError(f"{path.name}: {NOT_A_NOTEBOOK}")
    file = path if path.is_file() else _main_file(path)
    if file is None:
        place, code = path, read_folder(path.parent, path.name, path)
    elif "." in file.stem:
        raise UserError(f"{file.name}: no Python module can have a dot in its name; rename the file")
    else:
        place, code = file, read_folder(file.parent, file.stem, file if file == path else None)
    if not code.files or not place.resolve().is_relative_to(path.parent.resolve()):
        raise UserError(f"{path.name}: is a link to a file elsewhere; put the file itself there")
    return Address(str(place), name, str(place), "", code)


def _main_file(submission: Path) -> Path | None:
    """Return the main file of a submission's folder; None for a package.

    Raises:
        UserError: there is no file, or several may be the main file.
    """
    folders = _folders_with_python(submission)
    if not folders:
        raise UserError(f"{submission.name}: is or has no Python file (no pipe, no broken link); hand in a file")
    files = [each for folder in folders for each in _python_files(folder)]
    if submission / MAIN[0] in files:
        return submission / MAIN[0]
    if submission / "__init__.py" in files:
        return None
    named = [each for each in files if each.name in MAIN]
    found = files if len(files) == 1 else named or [each for each in files if _defines_a_form(each)]
    if len(found) != 1:
        names = ", ".join(each.relative_to(submission).as_posix() for each in files)
        raise UserError(f"{submission.name}: may be {names}; call the one that counts {MAIN[0]}")
    return found[0]


def _folders_with_python(folder: Path) -> list[Path]:
    """Return a folder if it contains Python files, else all folders in it that do, at any depth."""
    if _python_files(folder):
        return [folder]
    inside = (
        sorted(each for each in folder.iterdir() if each.is_dir() and each.name[0] not in "._")
        if folder.is_dir()
        else []
    )
    return [found for each in inside if not each.is_symlink() for found in _folders_with_python(each)]


def _python_files(folder: Path) -> list[Path]:
    return sorted(each for each in folder.glob("*.py") if each.is_file() and not each.name.startswith("."))


def _defines_a_form(path: Path) -> bool:
    """Return whether a file defines, at its top level, a callable that counts or an online class; it does not run."""
    try:
        body = ast.parse(path.read_bytes()).body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return False
    names, classes = set[str](), list[set[str]]()
    for each in body:
        if isinstance(each, ast.Assign):
            names |= {target.id for target in each.targets if isinstance(target, ast.Name)}
        elif isinstance(each, ast.FunctionDef | ast.ClassDef):
            names.add(each.name)
        if isinstance(each, ast.ClassDef):
            classes.append({part.name for part in each.body if isinstance(part, ast.FunctionDef)})
    return bool(names & {*NAMES}) or any({"predict", "update"} <= methods for methods in classes)


def _is_python(path: Path) -> bool:
    """Return whether a path is a Python file by its name; it may be a pipe, a device or a broken link."""
    return path.suffix == ".py" and not path.is_dir()
