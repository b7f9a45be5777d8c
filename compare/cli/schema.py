"""`slamgauge schema`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

import tyro

from slamgauge.compare.cli.options import print_result

Kind = Literal[
    "metrics", "summary", "sweep", "budget", "claims", "grades", "noise", "bench", "check", "scenarios", "doctor"
]


@dataclass
class Schema:
    """Print the JSON Schema of a result file or of the output of --json, with meanings and units.

    For example:
      slamgauge schema metrics
    """

    kind: tyro.conf.Positional[Kind]
    """The name of the file, or of the command that prints it."""

    def __call__(self) -> int:
        """Print the schema; return the exit status."""
        schema = files("slamgauge.compare.schemas") / f"{self.kind}.json"
        return 0 if print_result(schema.read_text(encoding="utf-8").rstrip()) else 1
