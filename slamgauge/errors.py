"""Whose fault it is: a user's mistake has its own type, the machine's refusals are known, all else is our defect."""

from __future__ import annotations

import errno

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
