"""Errors of the machine and errors of users."""

from __future__ import annotations

import errno

import pytest

from slamgauge.errors import UserError, refused_by_the_machine


@pytest.mark.parametrize(
    ("error", "refused"),
    [
        (MemoryError(), True),
        (OSError(errno.ENOSPC, "No space left on device"), True),
        (ConnectionResetError(errno.ECONNRESET, "Connection reset by peer"), True),
        (FileNotFoundError(errno.ENOENT, "No such file or directory"), False),
        (PermissionError(errno.EACCES, "Permission denied"), False),
        (OSError("without a number"), False),
        (UserError("a mistake"), False),
        (RuntimeError("a defect"), False),
    ],
)
def test_lack_of_memory_space_and_connections_is_an_error_of_the_machine(error: Exception, refused: bool) -> None:
    assert refused_by_the_machine(error) is refused
    mistake = UserError("estimator own.py:estimate: it raised an error")
    mistake.__cause__ = error
    assert refused_by_the_machine(mistake) is refused


def test_a_users_mistake_is_a_value_error() -> None:
    assert issubclass(UserError, ValueError)
