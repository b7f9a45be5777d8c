"""Commands that print what is installed with slamgauge: `slamgauge scenarios` and `schema`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

import tyro

from slamgauge.compare.cli.terminal import Output, put

Kind = Literal["metrics", "summary", "sweep", "budget", "grades", "noise", "bench", "check", "scenarios", "doctor"]


@dataclass
class Scenarios:
    """List the shipped scenarios with descriptions. In a pipe, each is one line.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""

    def __call__(self) -> int:
        from slamgauge.compare.scenarios.scenario import shipped_scenarios
        from slamgauge.compare.scoring.text_page import Page

        found = shipped_scenarios()
        width = max(len(name) for name, _ in found)
        page = Page(tuple(f"{name:{width}}  {text}" for name, text in found))
        output = Output(self.json, wide=not sys.stdout.isatty())
        return 0 if output.show([{"name": name, "description": text} for name, text in found], page) else 1


@dataclass
class Schema:
    """Print the JSON Schema of a result file or of the output of --json, with meanings and units.

    For example:
      slamgauge schema metrics
    """

    kind: tyro.conf.Positional[Kind]
    """The name of the file, or of the command that prints it."""

    def __call__(self) -> int:
        schema = files("slamgauge.compare.schemas") / f"{self.kind}.json"
        return 0 if put(schema.read_text(encoding="utf-8").rstrip()) else 1
