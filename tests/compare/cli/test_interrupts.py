"""An interrupt at any moment of a command ends it with its status, without an exception that Python would print."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from slamgauge.compare.cli import main as entry

pytestmark = pytest.mark.slow

INTERRUPTED = 128 + signal.SIGINT
MOST_LINES = 200


@pytest.fixture(autouse=True)
def deaf_shell() -> Any:
    """Ignore signals that arrive before the command handles them, and after it."""

    def ignore(number: int, frame: FrameType | None) -> None:
        pass

    before = signal.signal(signal.SIGINT, ignore)
    yield
    signal.signal(signal.SIGINT, before)


def status_with_interrupt_at(line: int) -> tuple[int, bool]:
    """Interrupt `slamgauge --version` at this line of its entry; return its status, and whether it has that line."""
    passed = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal passed
        if frame.f_code.co_filename != entry.__file__:
            return None
        if event == "line":
            passed += 1
            if passed == line:
                signal.raise_signal(signal.SIGINT)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        return entry.main(["--version"]), passed >= line
    finally:
        sys.settrace(before)


def test_at_each_line_of_the_entry(capsys: pytest.CaptureFixture[str]):
    statuses: list[int] = []
    for line in range(1, MOST_LINES):
        status, reached = status_with_interrupt_at(line)
        if not reached:
            break
        statuses.append(status)
    assert 20 < len(statuses) < MOST_LINES - 1
    assert {*statuses} == {0, INTERRUPTED}
    assert statuses[0] == statuses[-1] == 0
    said = {*capsys.readouterr().err.splitlines()}
    assert said == {"slamgauge: interrupted; nothing was written"}


def returning(command: Callable[[], int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the entry run this command."""

    def parse(*_: object) -> Callable[[], int]:
        return command

    monkeypatch.setattr(entry, "parse", parse)


def test_in_a_destructor_the_command_is_interrupted_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Python drops exceptions in destructors and callbacks of C code: the interrupt was printed and lost."""

    class Last:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.0)

    def command() -> int:
        last = Last()
        del last
        time.sleep(20.0)
        return 0

    returning(command, monkeypatch)
    began = time.monotonic()
    assert entry.main(["explain", "nees"]) == INTERRUPTED
    assert time.monotonic() - began < 10.0
    assert capsys.readouterr().err == "slamgauge: interrupted; nothing was written\n"


def test_the_first_signal_gives_the_status(monkeypatch: pytest.MonkeyPatch):
    def command() -> int:
        try:
            signal.raise_signal(signal.SIGTERM)
            time.sleep(1.0)
        finally:
            signal.raise_signal(signal.SIGINT)  # soon after the first: it does not disturb the end of the command
        return 0

    returning(command, monkeypatch)
    assert entry.main(["explain", "nees"]) == 128 + signal.SIGTERM
