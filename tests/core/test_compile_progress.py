"""Progress lines while kernels are loaded or compiled."""

from __future__ import annotations

import io
import re
import sys
import threading
from pathlib import Path

import pytest

from slamgauge import compile_progress

ROOT = Path(__file__).parents[2]


class Terminal(io.StringIO):
    """Standard error of a terminal, or of a file."""

    def __init__(self, *, terminal: bool) -> None:
        super().__init__()
        self.terminal, self.written = terminal, threading.Semaphore(0)

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str, /) -> int:
        count = super().write(text)
        self.written.release()
        return count


def told(monkeypatch: pytest.MonkeyPatch, *compiled: bool, terminal: bool = False) -> str:
    """Return the output for these kernels; each takes long."""
    stream = Terminal(terminal=terminal)
    monkeypatch.setattr(compile_progress, "ANNOUNCE_AFTER", 1e-3)
    monkeypatch.setattr(compile_progress, "ANNOUNCE_LOADING_AFTER", 1e-3)
    monkeypatch.setattr(sys, "stderr", stream)
    with compile_progress.announced("filter kernels", 50):
        for each in compiled:
            compile_progress.note(compiled=each)
            assert stream.written.acquire(timeout=10.0)
    return stream.getvalue()


def test_compilation_is_reported(monkeypatch: pytest.MonkeyPatch):
    line = "slamgauge: compiling ~50 filter kernels on first use ...\n"
    assert told(monkeypatch, True) == line


def test_loading_is_reported(monkeypatch: pytest.MonkeyPatch):
    assert told(monkeypatch, False) == "slamgauge: loading filter kernels from disk ...\n"


def test_lines_fit_a_terminal(monkeypatch: pytest.MonkeyPatch):
    sources = [path.read_text() for folder in ("ekf", "graph_baseline") for path in (ROOT / folder).rglob("*.py")]
    names: list[str] = [name for source in sources for name in re.findall(r'compiling\("(.*)", \d+\)', source)]
    for terminal, more in ((False, 0), (True, len("999" * 2) - len("1" + "0"))):
        line = told(monkeypatch, True, terminal=terminal).strip()
        assert len(line.replace("filter kernels", max(names, key=len))) + more <= 80


def test_one_line_outside_terminals(monkeypatch: pytest.MonkeyPatch):
    stream = Terminal(terminal=False)
    monkeypatch.setattr(compile_progress, "ANNOUNCE_AFTER", 1e-3)
    monkeypatch.setattr(sys, "stderr", stream)
    with compile_progress.announced("filter kernels", 50):
        for _ in range(20):
            compile_progress.note(compiled=True)
            threading.Event().wait(2e-3)
    assert stream.getvalue().count("\n") == 1


def test_a_terminal_shows_the_count(monkeypatch: pytest.MonkeyPatch):
    text = told(monkeypatch, True, True, True, terminal=True)
    assert "\rslamgauge: compiling ~50 filter kernels on first use ... 1 done, 0 s" in text
    assert text.endswith(" s\n")


def test_nothing_is_printed_for_quick_work(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setattr(compile_progress, "ANNOUNCE_AFTER", 60.0)
    with compile_progress.announced("filter kernels", 50):
        compile_progress.note(compiled=True)
    assert capsys.readouterr().err == ""
