"""`slamgauge scenarios`."""

from __future__ import annotations

from dataclasses import dataclass

from slamgauge.compare.cli.options import print_result


@dataclass
class Scenarios:
    """List the shipped scenarios with a line each.

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
        table = "\n".join(f"{name:{width}}  {text}" for name, text in found)
        printed = print_result([{"name": name, "description": text} for name, text in found] if self.json else table)
        return 0 if printed else 1
