"""Write pictures and pages next to finished results; a picture that fails does not affect the others."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.errors import UserError, failure_text
from slamgauge.memory import give_back

Drawing = Callable[[Path], object]  # writes its files into the given folder


def decorate(out: Path, drawings: Mapping[str, Drawing], writes: Sequence[str]) -> bool:
    """Draw pictures of the results in `out` and publish them; print one line for each drawing that fails.

    Args:
        out: Folder of the results.
        drawings: Functions that draw, by the name of their files without extension.
        writes: Every file that these drawings may write. Old files of slamgauge that are not drawn now are removed.

    Returns:
        True if all drawings were published.
    """
    lost: list[str] = []
    give_back()
    try:
        with staged_folder(out, writes, last="") as stage:
            for name, draw in drawings.items():
                try:
                    draw(stage)
                except Exception as error:  # noqa: BLE001 the other pictures are still drawn
                    for path in [*stage.rglob("*")]:
                        if path.relative_to(stage).as_posix().startswith(f"{name}."):
                            path.unlink()
                    lost.append(f"{out / name}: not written ({failure_text(error)}); all other files are written")
    except UserError as error:
        lost.append(f"{error} (no pictures are written; the results are complete)")
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the results are in {out}, without pictures") from None
    for line in lost:
        print(f"slamgauge: {line}", file=sys.stderr)
    return not lost
