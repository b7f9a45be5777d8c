"""The shipped scenarios: `slamgauge scenarios`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from slamgauge.compare.cli.terminal import Output


@dataclass
class Scenarios:
    """List the shipped scenarios with descriptions. In a pipe, each is one line.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> None:
        from slamgauge.compare.scenarios.scenario import shipped_scenarios
        from slamgauge.compare.scoring.text_page import Page

        found = shipped_scenarios()
        width = max(len(name) for name, _ in found)
        page = Page(tuple(f"{name:{width}}  {text}" for name, text in found))
        output = Output(self.json, wide=not sys.stdout.isatty())
        output.show([{"name": name, "description": text} for name, text in found], page)
