"""The shipped scenarios: `slamgauge scenarios`."""

from __future__ import annotations

import sys

from slamgauge.compare.cli.options.machine import Scenarios
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.scenarios.scenario import shipped_scenarios
from slamgauge.compare.scoring.text_page import Page


def run(command: Scenarios) -> None:
    """Run the command; return the exit status."""
    found = shipped_scenarios()
    width = max(len(name) for name, _ in found)
    page = Page(tuple(f"{name:{width}}  {text}" for name, text in found))
    output = Output(command.json, wide=not sys.stdout.isatty())
    output.show([{"name": name, "description": text} for name, text in found], page)
