"""The shipped scenarios: `slamgauge scenarios`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.scenarios import scenario
from slamgauge.compare.scoring import table


@dataclass
class Command:
    """List the shipped scenarios with descriptions. In a pipe, each is one line.

    For example:
      slamgauge scenarios

    Attributes:
        json: Print JSON on standard output.
    """

    json: bool = False

    def run(self) -> int:
        found = scenario.shipped_scenarios()
        width = max(len(name) for name, _ in found)
        page = table.Page(tuple(f"{name:{width}}  {text}" for name, text in found))
        content = [{"name": name, "description": text} for name, text in found]
        Output(self.json, wide=not sys.stdout.isatty()).show(content, page)
        return 0
