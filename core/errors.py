"""Three kinds of failures: a user's mistake (`UserError`), a refusal of the machine, and else a defect of slamgauge."""

from __future__ import annotations

import errno
import traceback
from pathlib import Path

# names in `errno`, some missing on some systems: no space, no memory, too many files, a broken device or connection
_REFUSALS = frozenset(
    (
        *("ENOSPC", "EDQUOT", "EFBIG", "EIO", "ENFILE", "EMFILE", "ENOMEM", "EAGAIN", "ESTALE"),
        *("ECONNRESET", "ECONNREFUSED", "ECONNABORTED", "ENETDOWN", "ENETUNREACH", "EHOSTUNREACH", "ETIMEDOUT"),
    )
)
_NO_LIBRARY = ("failed to map segment", "Could not find/load shared object")  # a library lacks memory


class UserError(ValueError):
    """Unusable input of a user. The text is one line with the place, the value and the remedy.

    The command `slamgauge` prints this line alone (exit status 2).
    """


class CovarianceError(UserError):
    """Matrices that are not covariances."""


def refused_by_the_machine(error: BaseException) -> bool:
    """Return whether the error or its cause is a lack of memory, disk space or connection: a retry may succeed."""
    refused = isinstance(error, OSError) and errno.errorcode.get(error.errno or 0) in _REFUSALS
    no_library = isinstance(error, ImportError | OSError) and any(text in str(error) for text in _NO_LIBRARY)
    if refused or no_library or isinstance(error, MemoryError):
        return True
    return error.__cause__ is not None and refused_by_the_machine(error.__cause__)


def failure_text(error: Exception) -> str:
    """Return a line for a failure: the text of a mistake or of a refusal, or the type and place of a defect."""
    if isinstance(error, UserError):
        return str(error)
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if refused_by_the_machine(error):
        return what
    frame = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(frame.filename).name}, line {frame.lineno}"
    return f"{what} ({where}; a defect of slamgauge, please report it)"
