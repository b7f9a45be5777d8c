"""`slamgauge scenarios`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from slamgauge.compare.cli.options import print_result


@dataclass
class Scenarios:
    """List the shipped scenarios, with a line each in pipes.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> int:
        """Print the list; the exit status."""
        from slamgauge.compare.scenarios.scenario import shipped_scenarios
        from slamgauge.compare.scoring.text_page import Page

        found = shipped_scenarios()
        width = max(len(name) for name, _ in found)
        page = Page(tuple(f"{name:{width}}  {text}" for name, text in found))
        table = page if sys.stdout.isatty() else str(page)  # programs read a line each
        printed = print_result([{"name": name, "description": text} for name, text in found] if self.json else table)
        return 0 if printed else 1
