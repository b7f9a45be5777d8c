"""Errors of user code, told in one line with the line of the user's file."""

from __future__ import annotations

import importlib
import sysconfig
from pathlib import Path
from traceback import extract_tb

from slamgauge import errors
from slamgauge.errors import CovarianceError, UserError

PAGE = "docs/your_filter.md"
MOST = 1000  # characters of an error's text
PYTHON_2 = ("Missing parentheses in call", "multiple exception types", "'xrange'", "'raw_input'", "'unicode'")
LIBRARIES = tuple({sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")})
SILENT = (Path(errors.__file__).parent, Path(__file__).parent, Path(__file__).parent / "forms")  # they run user code


class UserCodeError(UserError):
    """User code did what its form does not allow; the message is complete."""


class OverdueError(UserCodeError):
    """User code exceeded its time limit."""


class FormError(UserCodeError):
    """User code has none of the forms: three lines and a wrapper to copy (`forms.signatures.no_form`)."""


class WrongCovarianceError(UserCodeError, CovarianceError):
    """User code returned an estimate with an invalid covariance."""


def reason_of(error: BaseException, folder: str = "") -> str:
    """Return in one line why user code returned no estimate, with the last line in `folder` if possible."""
    if isinstance(error, UserCodeError):
        return str(error)
    what = f"it raised {type(error).__name__}: {_message_of(error)}"
    if not isinstance(error, SyntaxError):  # its message names the line
        frames = [each for each in extract_tb(error.__traceback__) if Path(each.filename).parent not in SILENT]
        frames = [each for each in frames if not each.filename.startswith(("<", importlib.__file__))]
        frames = [each for each in frames if not each.filename.startswith(LIBRARIES)] or frames
        frames = [each for each in frames if folder and each.filename.startswith(folder)] or frames
        what += "".join(f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in frames[-1:])
    return f"{what}; {_remedy(error)}"


def _remedy(error: BaseException) -> str:
    if isinstance(error, FileNotFoundError) and isinstance(error.filename, str):
        name = Path(error.filename).name
        return f"read {name} below `if __name__ == '__main__':`, or open Path(__file__).parent / {name!r}"
    if isinstance(error, ModuleNotFoundError):
        return f"install {error.name} beside slamgauge, or move the filter into a file without it ({PAGE})"
    if isinstance(error, SyntaxError | NameError):
        line, text = (getattr(error, "text", None) or "").strip(), _message_of(error)
        if line.startswith(("%", "!")) or "'get_ipython'" in text:
            return "remove the lines that only a notebook can run (get_ipython, %, !)"
        if any(part in text for part in PYTHON_2):
            return "this is code of Python 2; convert it to Python 3"
    return "mend it and run again"


def _message_of(error: BaseException) -> str:
    """Return the text of an error in one line, at most `MOST` characters; user code may have written its `__str__`."""
    try:
        text = str(error)[:MOST]
    except Exception as another:  # noqa: BLE001 user code may raise anything
        return f"(no message: its text raised {type(another).__name__})"
    return " ".join(text.split()) or "(no message)"
