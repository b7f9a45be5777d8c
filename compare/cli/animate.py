"""A run as a moving picture: `slamgauge animate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from slamgauge.compare.cli.common import split_names
from slamgauge.compare.figures import frames


@dataclass
class Command:
    """Draw a run as a moving picture: animation.gif.

    It shows the paths, robots and maps of the filtered estimates (of more than three, only the first) and the paths of
    the smoothed ones. The page of a study has the commands of its runs.

    For example:
      slamgauge animate first-run --estimators ekf,riekf --seconds 20 --fps 25

    Attributes:
        folder: Folder that `slamgauge run` or `evaluate --out` wrote. The animation is written there too.
        estimators: Comma-separated: estimators to show, as the command of the run named them. No code of yours is run.
        seconds: Duration.
        fps: Frames per second. More frames make a larger GIF.
    """

    folder: tyro.conf.Positional[Path]
    estimators: str = ""
    seconds: float = 10.0
    fps: int = 10

    def run(self) -> int:
        frames.animate(self.folder, split_names(self.estimators), self.seconds, self.fps)
        print(f"written to {self.folder}: {frames.GIF}", file=sys.stderr)
        return 0
