"""Options of `slamgauge bench`, `doctor` and `scenarios`."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamgauge.compare.cli.options.shared import Estimators, Folder, Options
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.registry import BENCHED


@dataclass
class Bench(Options):
    """Measure step times for several map sizes, next to a plain numpy filter (the four default sizes take 20 minutes).

    For example:
      slamgauge bench --landmarks 20,100 --estimators ekf,riekf
    """

    landmarks: str = "20,100,300,1000"
    """Comma-separated map sizes."""

    estimators: Estimators = BENCHED

    out: Folder | None = None
    """Folder of bench.json, bench.png and bench.svg. Without it they are not written."""

    output: Output = field(default_factory=Output)


@dataclass
class Doctor(Options):
    """Print what a bug report needs: versions, BLAS, threads, compiled code, gtsam, programs and free memory.

    Exit status 1 if something that slamgauge needs is missing.

    For example:
      slamgauge doctor
    """

    clear_cache: bool = False
    """First remove the stored machine code; slamgauge then compiles again what it needs."""

    json: bool = False
    """Print JSON on standard output instead of the table."""


@dataclass
class Scenarios(Options):
    """List the shipped scenarios with descriptions. In a pipe, each is one line.

    For example:
      slamgauge scenarios
    """

    json: bool = False
    """Print JSON on standard output."""
