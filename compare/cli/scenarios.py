"""`slamgauge scenarios`."""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import fill

from slamgauge.compare.cli.options import print_result
from slamgauge.compare.cli.terminal import line_width


@dataclass
class Scenarios:
    """List the shipped scenarios.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> int:
        """Print the list; the exit status."""
        from slamgauge.compare.scenarios.scenario import shipped_scenarios

        found = shipped_scenarios()
        width = max(len(name) for name, _ in found)
        below = " " * (width + 2)
        lines = [fill(f"{name:{width}}  {text}", line_width(), subsequent_indent=below) for name, text in found]
        table = "\n".join(lines)
        printed = print_result([{"name": name, "description": text} for name, text in found] if self.json else table)
        return 0 if printed else 1
