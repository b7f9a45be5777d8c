"""`slamgauge schema`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import tyro

from slamgauge.compare.cli.options import print_result

Kind = Literal[
    "metrics", "summary", "sweep", "budget", "claims", "grades", "noise", "bench", "check", "scenarios", "doctor"
]


@dataclass
class Schema:
    """Print what the JSON of a file or of --json is made of: a JSON Schema, with units and meanings.

    For example:
      slamgauge schema metrics
    """

    kind: tyro.conf.Positional[Kind]
    """The name of the file, or of the command that prints it."""

    def __call__(self) -> int:
        """Print; the exit status."""
        from slamgauge.compare.schemas.kinds import SCHEMAS

        return 0 if print_result(SCHEMAS[self.kind]) else 1
