"""What all tests share."""

from __future__ import annotations

import pytest

from slamgauge.compare.cli import terminal


@pytest.fixture(autouse=True)
def whole_lines(monkeypatch: pytest.MonkeyPatch):
    """Commands print what they say in whole lines here; `compare/cli/test_terminal.py` tests how lines are broken."""
    monkeypatch.setattr(terminal, "PIPED", 10_000)
