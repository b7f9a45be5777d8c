from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge import memory
from slamgauge.errors import UserError


def test_what_fits_is_let_through_and_what_does_not_is_a_line() -> None:
    memory.require_memory(1.0, "a byte", "none")
    with pytest.raises(UserError, match=r"^a map needs 1000000000\.0 GB of memory, and .* GB are free; take less$"):
        memory.require_memory(1e18, "a map", "take less")


def test_free_memory_is_what_the_system_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = tmp_path / "meminfo"
    monkeypatch.setattr(memory, "FREE_IN_PROC", told)
    told.write_text("MemTotal: 9000 kB\nMemAvailable: 1000 kB\n")
    assert memory.free_memory() == 1_024_000.0
    told.unlink()
    assert memory.free_memory() > 1e8
