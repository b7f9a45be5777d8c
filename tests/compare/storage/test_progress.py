"""Progress: lines with the remaining time in log files; bars on terminals and in notebooks."""

from __future__ import annotations

import sys
import threading
from types import ModuleType

import pytest
from tqdm import tqdm

from slamgauge.compare.storage.progress import LogLines, counted, duration, refreshed, tracked


def test_log_files_get_lines_at_growing_intervals(capsys: pytest.CaptureFixture[str]):
    now = 0.0
    lines = LogLines(200, "run", "q1", done=100, clock=lambda: now)
    for _ in range(100):
        now += 10.0
        lines.update()
    assert capsys.readouterr().err.splitlines() == [
        "q1: 103 of 200 runs, about 16 min left",
        "q1: 105 of 200 runs, about 16 min left",
        "q1: 108 of 200 runs, about 15 min left",
        "q1: 112 of 200 runs, about 15 min left",
        "q1: 118 of 200 runs, about 14 min left",
        "q1: 127 of 200 runs, about 12 min left",
        "q1: 141 of 200 runs, about 10 min left",
        "q1: 162 of 200 runs, about 6 min left",
        "q1: 193 of 200 runs, about 70 s left",
    ]


def test_a_long_item_gets_lines_at_growing_intervals(capsys: pytest.CaptureFixture[str]):
    now = 0.0
    lines = LogLines(2, "estimator", "batch", clock=lambda: now)
    for _ in range(40):
        now += 1.0
        lines.refresh()
    assert capsys.readouterr().err.splitlines() == [
        "batch: 0 of 2 estimators, 10 s",
        "batch: 0 of 2 estimators, 15 s",
        "batch: 0 of 2 estimators, 23 s",
        "batch: 0 of 2 estimators, 35 s",
    ]


def test_a_display_is_refreshed_while_an_item_runs():
    lines, called, shown = LogLines(1, "estimator"), threading.Event(), list[str]()
    lines.set_description, lines.refresh = shown.append, called.set
    with refreshed(lines, lambda: "causal", every=0.01):
        assert called.wait(60.0)
    assert shown[0] == "causal"


def test_short_work_prints_nothing(capsys: pytest.CaptureFixture[str]):
    assert list(tracked([1, 2, 3], 3, "frame", "film")) == [1, 2, 3]
    assert capsys.readouterr().err == ""


def test_notebooks_and_terminals_have_bars(monkeypatch: pytest.MonkeyPatch):
    assert isinstance(counted(3, "run"), LogLines)
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    with counted(3, "run") as bar:
        assert isinstance(bar, tqdm)


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0 s"), (89, "89 s"), (95, "2 min"), (9000, "2.5 h")])
def test_durations(seconds: float, text: str):
    assert duration(seconds) == text
