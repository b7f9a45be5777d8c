"""Progress: a line every half minute in log files; bars on terminals and in notebooks."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from slamgauge.compare.storage import progress


def test_long_work_prints_lines_to_log_files_and_bars_in_notebooks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    assert list(progress.counted(3, "frame", items=[1, 2, 3])) == [1, 2, 3]
    assert capsys.readouterr().err == ""  # short work
    monkeypatch.setattr(progress, "INTERVAL", 0.0)
    with progress.counted(200, "run", "q1", done=100) as lines:
        lines.update(99)
    assert "q1: 100%|" in capsys.readouterr().err.replace("\r", "\n").splitlines()[-2]
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    with progress.counted(3, "run"):
        assert "0/3" in capsys.readouterr().err
