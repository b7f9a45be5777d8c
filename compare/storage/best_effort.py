"""Pictures and pages beside results that are written already: whatever becomes of one costs that one alone."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError, failure_text
from slamgauge.memory import give_back

Drawing = Callable[[Path], object]  # writes its files into the folder that it is given


def decorate(out: Path, beside: str, drawings: Mapping[str, Drawing], writes: Sequence[str]) -> bool:
    """Draw what belongs to the results in `out` and publish what has come of it; each failure is a line of its own.

    Args:
        out: the folder of the results.
        beside: the file of the results that tells of them; if another command replaces it meanwhile, nothing is
            published beside it.
        drawings: what is to be drawn; the files of each are called as its key, with an ending.
        writes: every file that drawings of this kind may write; old ones of ours that are not drawn now go.

    Returns:
        Whether all are there.
    """
    lost: list[str] = []
    give_back()
    try:
        with staged_folder(out, writes, last="", beside=beside) as stage:
            for name, draw in drawings.items():
                try:
                    draw(stage)
                except Exception as error:  # noqa: BLE001 the results are there, and the other pictures shall be
                    _remove(stage, name)
                    lost.append(f"{out / name}: left out ({failure_text(error)}); all else is written")
    except UserError as error:
        lost.append(f"{error} (pictures are left out, the results are written)")
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the results are in {out}, without pictures") from None
    for line in lost:
        print(f"slamgauge: {line}", file=sys.stderr)
    return not lost


def _remove(stage: Path, name: str) -> None:
    """Remove what is half drawn."""
    for path in [path for path in stage.rglob("*") if path.relative_to(stage).as_posix().startswith(f"{name}.")]:
        path.unlink()
