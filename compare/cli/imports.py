"""Recordings of others: `slamgauge import`."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from slamgauge.compare.cli.options import (
    Folder,
)
from slamgauge.compare.storage.result_files import RECORDING, TRUTH

if TYPE_CHECKING:
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth


IMPORTED = (RECORDING, TRUTH)


@dataclass
class VictoriaPark:
    """The Victoria Park recording, as distributed with GTSAM's examples (no ground truth)."""

    path: tyro.conf.Positional[Path]
    """victoria_park.txt"""

    out: Folder
    """Folder for recording.npz."""

    max_range: float = math.inf
    """Drop observations from farther away [m]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.victoria_park import read_victoria_park

        _store(self.out, read_victoria_park(self.path, max_range=self.max_range), None)


@dataclass
class LostInTheWoods:
    """The Lost in the Woods recording (University of Toronto, AER1513), with ground truth."""

    path: tyro.conf.Positional[Path]
    """dataset2.mat"""

    out: Folder
    """Folder for recording.npz and truth.npz."""

    max_range: float = 5.0
    """Drop observations from farther away [m]."""

    lateral_slip: float = 0.02
    """Standard deviation of the sideways velocity that estimators shall assume [m/s]."""

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods

        recording, truth = read_lost_in_the_woods(self.path, max_range=self.max_range, lateral_slip=self.lateral_slip)
        _store(self.out, recording, truth)


@dataclass
class Import:
    """Turn a published recording into recording.npz (and truth.npz)."""

    format: (
        Annotated[VictoriaPark, tyro.conf.subcommand(name="victoria-park")]
        | Annotated[LostInTheWoods, tyro.conf.subcommand(name="lost-in-the-woods")]
    )

    def __call__(self) -> None:
        """Read and store."""
        from slamgauge.compare.storage.manifest import require_free

        require_free(self.format.out, IMPORTED)  # before long files are read
        self.format()


def _store(out: Path, recording: Recording, truth: Truth | None) -> None:
    from slamgauge.compare.storage.files import save
    from slamgauge.compare.storage.staged_folder import staged_folder

    with staged_folder(out, IMPORTED, last=IMPORTED[0]) as folder:
        save(folder / RECORDING, recording)
        if truth is not None:
            save(folder / TRUTH, truth)
    print(
        f"{recording.steps} steps, {len(recording.observation)} observations, "
        f"{'with' if truth is not None else 'no'} ground truth: written to {out}",
        file=sys.stderr,
    )
