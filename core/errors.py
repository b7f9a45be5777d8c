"""Whose fault it is: a user's mistake has its own type, the machine's refusals are known, all else is our defect."""

from __future__ import annotations

import errno
import traceback
from pathlib import Path

# names in `errno`, not all of them on every system: no room, no memory or files left, a broken device or connection
_REFUSALS = frozenset(
    (
        *("ENOSPC", "EDQUOT", "EFBIG", "EIO", "ENFILE", "EMFILE", "ENOMEM", "EAGAIN", "ESTALE"),
        *("ECONNRESET", "ECONNREFUSED", "ECONNABORTED", "ENETDOWN", "ENETUNREACH", "EHOSTUNREACH", "ETIMEDOUT"),
    )
)


class UserError(ValueError):
    """What the user gave cannot be used: one line that says where it stands, what it is and the remedy.

    The command `slamgauge` prints that line alone (exit status 2). It is a `ValueError`, as in other libraries.
    """


def refused_by_the_machine(error: BaseException) -> bool:
    """Whether memory, room or a connection was lacking, here or in the cause; the same may succeed another time."""
    refused = isinstance(error, OSError) and errno.errorcode.get(error.errno or 0) in _REFUSALS
    if refused or isinstance(error, MemoryError):
        return True
    return error.__cause__ is not None and refused_by_the_machine(error.__cause__)


def failure_text(error: Exception) -> str:
    """What is known of a failure, in one line: a mistake, a refusal of the machine, or a defect and where it shows."""
    if isinstance(error, UserError):
        return str(error)
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if refused_by_the_machine(error):
        return what
    frame = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(frame.filename).name}, line {frame.lineno}"
    return f"{what} ({where}; a defect of slamgauge, please report it)"
