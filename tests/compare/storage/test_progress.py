"""Progress: lines in log files; bars on terminals and in notebooks."""

from __future__ import annotations

import re
import sys
import threading
from types import ModuleType

import pytest
from tqdm import tqdm

from slamgauge.compare.storage.progress import LogLines, counted, refreshed, tracked


def test_log_files_get_lines_at_growing_intervals(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(LogLines, "due", 0.0)
    with counted(200, "run", "q1", done=100) as lines:
        assert isinstance(lines, LogLines)
        lines.due = 0.0
        lines.update(99)
    (*_, last) = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"q1: 199 of 200 runs, \d\d:\d\d, about .* left", last)
    assert lines.due > 0.0
    monkeypatch.undo()
    assert list(tracked([1, 2, 3], 3, "frame", "film")) == [1, 2, 3]
    assert capsys.readouterr().err == ""  # short work


def test_a_display_is_refreshed_while_an_item_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(LogLines, "due", 0.0)
    shown = threading.Event()
    monkeypatch.setattr(LogLines, "set_description", lambda self, text: (self.set_description_str(text), shown.set()))
    with counted(2, "estimator", alike=False) as lines, refreshed(lines, lambda: "causal: ", every=0.01):
        assert shown.wait(60.0)
    assert "causal: 0 of 2 estimators, 00:0" in capsys.readouterr().err


def test_notebooks_and_terminals_have_bars(monkeypatch: pytest.MonkeyPatch):
    assert isinstance(counted(3, "run"), LogLines)
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    with counted(3, "run") as bar:
        assert type(bar) is tqdm
