"""Errors of the machine and of users; free memory."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from slamgauge import memory
from slamgauge.errors import UserError, refused_by_the_machine


def test_work_that_does_not_fit_is_refused_in_a_line() -> None:
    memory.require_memory(1.0, "a byte", "none")
    with pytest.raises(UserError, match=r"^a map needs 1000000000\.0 GB of memory, and .* GB are free; take less$"):
        memory.require_memory(1e18, "a map", "take less")


def test_free_memory_equals_the_system_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = tmp_path / "meminfo"
    monkeypatch.setattr(memory, "FREE_IN_PROC", told)
    told.write_text("MemTotal: 9000 kB\nMemAvailable: 1000 kB\n")
    assert memory.free_memory() == 1_024_000.0
    told.unlink()
    assert memory.free_memory() > 1e8


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
